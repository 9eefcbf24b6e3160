from __future__ import annotations

import threading
import warnings

import matplotlib as mpl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.plots.canvas import new_axes, png_bytes
from everplace.plots.style import line_looks, set_legend, shortened, styled, write_plainly


def test_style_is_undone_even_after_an_error() -> None:
    before = dict(mpl.rcParams)
    with pytest.raises(KeyError), styled():
        raise KeyError(mpl.rcParams["legend.frameon"])
    assert dict(mpl.rcParams) == before


def test_a_readers_own_settings_do_not_reach_the_picture() -> None:
    with mpl.rc_context({"text.usetex": True, "image.cmap": "jet"}):
        with styled():
            assert mpl.rcParams["text.usetex"] is False
            assert mpl.rcParams["image.cmap"] == "viridis"
        assert mpl.rcParams["text.usetex"] is True


def test_threads_that_overlap_leave_nothing_behind() -> None:
    before = dict(mpl.rcParams)
    inside = threading.Event()

    def first() -> None:
        with styled():
            inside.set()
            # Long enough for the second thread to wait at the entrance.
            threading.Event().wait(0.05)

    def second() -> None:
        inside.wait()
        with styled():
            threading.Event().wait(0.05)

    threads = [threading.Thread(target=first), threading.Thread(target=second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert dict(mpl.rcParams) == before


def test_twenty_eight_labels_look_different_and_never_change() -> None:
    labels = [f"method {number}" for number in range(28)]
    looks = line_looks(labels)
    assert len(set(looks.values())) == 28
    assert line_looks(labels[:3]) == {label: looks[label] for label in labels[:3]}
    assert list(line_looks(["a", "b", "a"])) == ["a", "b"]
    assert len(line_looks(map(str, range(100)))) == 100


@settings(max_examples=50)
@given(st.text(max_size=60), st.floats(0.05, 4.0))
def test_shortened_text_fits_and_keeps_both_ends(text: str, width: float) -> None:
    short = shortened(text, width, 8.0)
    room = max(2, int(width * 72 / 4.8))
    assert len(short) <= room
    if len(text) <= room:
        assert short == text
    else:
        assert "…" in short
        assert text.startswith(short.split("…")[0])


def test_shortened_golden() -> None:
    assert shortened("images-00010-and-more", 10 * 4.8 / 72 + 1e-9, 8.0) == "image…more"


def test_legend_shows_labels_that_matplotlib_would_hide_or_read_as_formula() -> None:
    figure, axes = new_axes(3, 2)
    lines = [axes.plot([0, 1])[0], axes.plot([1, 0])[0]]
    title = axes.set_title("cost $x$ and $\\broken")
    write_plainly(title)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        legend = set_legend(axes, lines, ["_run", "a $\\nonsense$ name"])
        assert png_bytes(figure, 50)
    assert [text.get_text() for text in legend.get_texts()] == ["_run", "a $\\nonsense$ name"]
