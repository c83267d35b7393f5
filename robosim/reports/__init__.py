"""Building blocks of reports: pages, plots, jobs in processes of their own, provenance.

Imports: base."""
