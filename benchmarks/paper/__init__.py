"""The paper, rerun: experiments, statistics, claims and report."""
