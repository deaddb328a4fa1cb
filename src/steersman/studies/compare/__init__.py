"""``steersman compare``: saved drives, trainings, benchmarks and controllers side by side."""
