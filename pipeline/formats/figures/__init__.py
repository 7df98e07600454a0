"""Maps and plots, for the report, for `renew plot` and for the documents."""
