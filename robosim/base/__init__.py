"""What every other folder stands on: errors, bundled files, files of results and of users, jobs, provenance, progress.

Imports: mpm.
"""
