"""What must survive: jobs, campaigns, schedules, keys, uploads, models. The only room that imports SQLAlchemy."""
