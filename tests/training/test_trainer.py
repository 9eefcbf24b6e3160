"""On which devices and with which precision training runs."""

from __future__ import annotations

import pytest
import torch

from everplace.training.trainer import bf16_is_fast


def test_bfloat16_is_used_only_where_the_device_multiplies_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True, "avx512_bf16": False}, raising=False)
    assert not bf16_is_fast("cpu")
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": True}, raising=False)
    assert bf16_is_fast("cpu")
