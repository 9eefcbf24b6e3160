"""The report: one HTML file with text, tables, pictures and interactive curves that needs no network."""
