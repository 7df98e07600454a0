"""`report.html`: a page that explains a run."""
