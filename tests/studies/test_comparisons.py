"""What the study of several comparisons says where there is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies import comparisons


@pytest.mark.parametrize("content", [None, "{", '{"pairs": [{}]}', "[]"])
def test_a_directory_without_a_comparison_is_named(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "metrics.json").write_text(content)
    with pytest.raises(SystemExit) as stopped:
        comparisons.main([str(tmp_path), "--out", str(tmp_path / "out")])
    assert stopped.value.code == f"{tmp_path} holds no comparison of `everplace compare`; name its --out"
    assert not (tmp_path / "out").exists()
