"""The report: one HTML file with its text, tables, pictures and interactive curves, which needs no network."""
