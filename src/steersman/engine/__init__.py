"""One way to run many jobs: local processes or a Ray cluster, with a journal, progress, resume."""
