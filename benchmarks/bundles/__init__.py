"""Results that travel: one archive with suite, arms, cases, chosen series and recordings, every byte under a digest."""
