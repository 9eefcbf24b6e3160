"""Whatever the described interface allows, and what it does not: no request makes the service fail."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)  # fmt: skip
from tests.serve.running_service import RunningService

EXAMPLES = int(os.environ.get("EVERPLACE_FUZZ", "15"))
"""Of each operation that takes anything, by the description and against it: 500 are 5,000 requests."""
CHECKS: list[Any] = [
    not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance,
]  # fmt: skip
WITHOUT_PARAMETERS = {"GET /map", "GET /healthz", "GET /metrics"}


def asked(operation: Any, mode: schemathesis.GenerationMode, frame: bytes) -> list[int]:
    """The statuses of requests to one operation, each of which was answered as the description says."""
    statuses: list[int] = []

    @settings(max_examples=EXAMPLES, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(case=operation.as_strategy(generation_mode=mode), with_frame=st.booleans())
    def ask(case: Any, with_frame: bool) -> None:
        if with_frame and isinstance(case.body, dict) and "image" in case.body:
            case.body["image"] = frame
        response = case.call(timeout=30)
        statuses.append(response.status_code)
        case.validate_response(response, checks=CHECKS)

    ask()
    return statuses


@pytest.mark.fuzz
@pytest.mark.slow
@pytest.mark.parametrize("mode", [schemathesis.GenerationMode.POSITIVE, schemathesis.GenerationMode.NEGATIVE])
def test_no_request_makes_the_service_fail(
    service: RunningService, winter: list[Path], mode: schemathesis.GenerationMode
) -> None:
    described = schemathesis.openapi.from_url(f"{service.url}openapi.json")
    frame = winter[7].read_bytes()
    seen: dict[str, list[int]] = {}
    for result in described.get_all_operations():
        operation: Any = result.ok()  # type: ignore[union-attr]
        if operation.label in WITHOUT_PARAMETERS and mode is schemathesis.GenerationMode.NEGATIVE:
            continue  # nothing can be wrong
        seen[operation.label] = asked(operation, mode, frame)
    assert set(seen) >= {"POST /localize", "POST /translate", "GET /frames/{id}", "DELETE /sessions/{session}"}
    assert all(seen.values())
    if mode is schemathesis.GenerationMode.POSITIVE:
        assert 200 in seen["POST /localize"]
    print({label: dict(Counter(statuses)) for label, statuses in seen.items()})
    assert service.localize(winter[0]).status_code == 200
