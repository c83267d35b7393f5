"""What every other folder stands on: errors, bundled files, files of results and of users, studies, digests, progress.

Imports: mpm."""
