"""What is let in: the cost of a job, checks of uploads and trainings, the plan of a campaign."""
