"""What the service answers where it does not do what it is asked."""

from __future__ import annotations

__all__ = ["RefusedError", "too_busy"]


class RefusedError(Exception):
    """An answer other than the wanted one.

    Attributes:
        status: Of HTTP.
        sentence: For whoever asked; no path and nothing of the inside.
        retry_after: Seconds after which asking again may help; 0: it will not.
    """

    def __init__(self, status: int, sentence: str, retry_after: int = 0) -> None:
        super().__init__(sentence)
        self.status, self.sentence, self.retry_after = status, sentence, retry_after

    @property
    def headers(self) -> dict[str, str]:
        """That go with it."""
        return {"Retry-After": str(self.retry_after)} if self.retry_after else {}


def too_busy() -> RefusedError:
    """There is more to do than the service takes on."""
    return RefusedError(503, "the service is busy; ask again in a second", retry_after=1)
