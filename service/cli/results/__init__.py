"""Commands for results that are over: data sets, bundles, leaderboards, citations."""
