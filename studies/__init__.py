"""The measured tables of docs/results.md: `python -m studies NAME --data DIR --out DIR`; a stopped study goes on."""
