"""A Ray cluster of two workers on this machine: the numbers of one process, whatever happens to a worker."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from tests.experiments.comparing import untrained_run

from everplace.cluster import map_on_cluster
from everplace.describe.files.descriptors import load_descriptors
from everplace.describe.on_cluster import ClusterDescriber
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, DescriptorsError, ImageError, MachineError, MissingExtraError
from everplace.mapping.route_map import Map
from everplace.route.folder import open_traverse

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::DeprecationWarning")]


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of a cluster of two workers."""
    ray = pytest.importorskip("ray", reason="needs the extra ray")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    context = ray.init(
        num_cpus=2, object_store_memory=256 << 20, include_dashboard=False, log_to_driver=False,
        logging_level=logging.ERROR,
    )  # fmt: skip
    yield context.address_info["gcs_address"]
    ray.shutdown()


@pytest.fixture(scope="module")
def summer(unchanged_rendered_route: Path) -> Path:
    return unchanged_rendered_route / "summer"


def squared() -> Callable[[int], int]:
    return _squared


def _squared(number: int) -> int:
    if number == 7:
        warnings.warn("seven", stacklevel=1)
    if number == 13:
        raise DescriptorsError("thirteen is not squared here")
    return number * number


def test_results_and_warnings_come_in_order_until_a_block_raises(cluster: str) -> None:
    results = map_on_cluster(squared, range(16))
    with pytest.warns(UserWarning, match="seven"):
        found = [next(results) for _ in range(13)]
    assert found == [number * number for number in range(13)]
    with pytest.raises(DescriptorsError, match=r"^thirteen is not squared here$"):
        next(results)


def test_nothing_is_computed_of_no_block(cluster: str) -> None:
    assert list(map_on_cluster(squared, [])) == []


def test_descriptors_are_those_of_one_process(cluster: str, summer: Path) -> None:
    drive = open_traverse(summer)
    found = ClusterDescriber("hog16").describe(drive, batch=7)
    wanted = open_describer("hog16").describe(drive)
    np.testing.assert_array_equal(found.values, wanted.values)
    for name in ("names", "image_names", "method", "metric", "settings"):
        assert getattr(found, name) == getattr(wanted, name)


def test_a_run_is_found_by_its_whole_path(
    cluster: str, summer: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = untrained_run(tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    drive = open_traverse(summer)[:40]
    found = ClusterDescriber(run.name).describe(drive)
    np.testing.assert_array_equal(found.values, open_describer(run).describe(drive).values)


def test_a_worker_that_is_killed_while_it_describes_costs_no_descriptor(cluster: str, summer: Path) -> None:
    drive = open_traverse(summer)
    passing = ClusterDescriber("hog16").describe_passing(drive, batch=1)
    rows = [next(passing.rows)]
    workers = [one for one in psutil.Process().children(recursive=True) if "MapWorker" in " ".join(one.cmdline())]
    assert workers
    workers[0].kill()
    rows.extend(passing.rows)
    np.testing.assert_array_equal(np.stack(rows), open_describer("hog16").describe(drive).values)


def test_the_command_writes_what_it_writes_without_a_cluster(cluster: str, summer: Path, tmp_path: Path) -> None:
    for engine in ("ray", "local"):
        command = [sys.executable, "-m", "everplace", "describe", "hog16", str(summer), "--engine", engine]
        done = subprocess.run(
            [*command, "--out", str(tmp_path / f"{engine}.h5")], capture_output=True, text=True, check=False,
            env={**os.environ, "RAY_ADDRESS": cluster},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    found, wanted = (load_descriptors(tmp_path / f"{engine}.h5") for engine in ("ray", "local"))
    np.testing.assert_array_equal(found.values, wanted.values)
    assert (found.names, found.image_names) == (wanted.names, wanted.image_names)


def test_a_broken_image_is_named_as_without_a_cluster(cluster: str, summer: Path, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    for path in sorted(summer.iterdir())[:20]:
        (drive / path.name).write_bytes(path.read_bytes())
    broken = sorted(drive.iterdir())[11]
    broken.write_bytes(broken.read_bytes()[:99])
    sentences = []
    for describer in (ClusterDescriber("hog16"), open_describer("hog16")):
        with pytest.raises(ImageError) as refused:
            describer.describe(open_traverse(drive))
        sentences.append(str(refused.value))
    assert sentences[0] == sentences[1]


def test_a_map_is_that_of_one_process(cluster: str, summer: Path, tmp_path: Path) -> None:
    found = Map.create(tmp_path / "ray", summer, method="hog16", engine="ray")
    wanted = Map.create(tmp_path / "local", summer, method="hog16")
    np.testing.assert_array_equal(found.descriptors(), wanted.descriptors())
    np.testing.assert_array_equal(found.projection.weight, wanted.projection.weight)
    assert found.frames("stem", "thumbnail", "features", "looks").equals(
        wanted.frames("stem", "thumbnail", "features", "looks")
    )
    assert found.document["calibration"] == wanted.document["calibration"]


def test_recordings_and_arrays_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="needs the extra ray")
    (tmp_path / "a.mp4").touch()
    with pytest.raises(ConfigError, match="describes directories of images"):
        Map.create(tmp_path / "map", tmp_path / "a.mp4", method="hog16", engine="ray")
    assert not (tmp_path / "map").exists()
    with pytest.raises(ConfigError, match="describes directories of images"):
        ClusterDescriber("hog16").describe(np.zeros((8, 8), np.uint8))


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(MissingExtraError, match=r"everplace\[ray\]"):
        ClusterDescriber("hog16")


def test_a_cluster_that_is_not_there_is_said_in_one_sentence(summer: Path, tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="needs the extra ray")
    command = [sys.executable, "-m", "everplace", "describe", "hog16", str(summer), "--engine", "ray"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "a.h5")], capture_output=True, text=True, check=False,
        env={**os.environ, "RAY_ADDRESS": "127.0.0.1:9"},
    )  # fmt: skip
    assert done.returncode == MachineError.exit_status, done.stderr
    assert done.stderr.count("\n") == 1
    assert (
        "the Ray cluster at 127.0.0.1:9, which RAY_ADDRESS names, cannot be reached (Connection refused)" in done.stderr
    )
    assert not (tmp_path / "a.h5").exists()
