"""Maps and plots for the report, `renew plot` and the documents."""
