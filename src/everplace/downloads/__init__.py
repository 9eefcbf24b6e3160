"""Downloading files: resumed where they broke off, checked, and whole by rename.

`fetch` gets one file and `fetch_all` several at a time. `server` asks for a file from a byte on and says what each
answer means; `partial` keeps what has come so far beside the target.
"""

from everplace.downloads.fetching import Download, fetch, fetch_all, sha256_of
from everplace.downloads.server import Patience

__all__ = ["Download", "Patience", "fetch", "fetch_all", "sha256_of"]
