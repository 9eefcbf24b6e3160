from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.errors import CheckpointError, DescriptorsError
from everplace.images.decoding import ImageSpec, decode_images
from everplace.mapping.condition_model import ConditionModel
from everplace.mapping.image_statistics import image_statistics
from everplace.render.render_config import CONDITIONS, render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route

Features = dict[str, NDArray[np.float32]]


@pytest.fixture(scope="module")
def drawn() -> Features:
    rng = np.random.default_rng(0)
    spread = rng.standard_normal((6, 6))
    return {
        name: (rng.standard_normal((240, 6)) @ spread + centre).astype(np.float32)
        for name, centre in (("day", 0.0), ("dusk", 6.0), ("night", 30.0))
    }


def _fit(features: Features, rows: slice = slice(None)) -> ConditionModel:
    chosen = {name: values[rows] for name, values in features.items()}
    return ConditionModel.fit(
        np.concatenate(list(chosen.values())), [name for name, values in chosen.items() for _ in values]
    )


def test_conditions_are_told_apart(drawn: Features) -> None:
    model = _fit(drawn, slice(0, 120))
    for name, values in drawn.items():
        answers = [model.posterior(one) for one in values[120:]]
        assert all(sum(answer.values()) == pytest.approx(1) for answer in answers)
        assert np.mean([max(answer, key=answer.__getitem__) == name for answer in answers]) > 0.9


@pytest.mark.parametrize("left_out", ["day", "dusk", "night"])
def test_a_condition_not_seen_before_is_flagged(drawn: Features, left_out: str) -> None:
    far = {name: values * np.float32(1) + np.float32(60) * (name == left_out) for name, values in drawn.items()}
    model = _fit({name: values for name, values in far.items() if name != left_out}, slice(0, 120))
    assert left_out not in model.conditions
    for name, values in far.items():
        flagged = model.unseen_rows(values[120:])
        assert flagged.mean() > 0.9 if name == left_out else flagged.mean() <= 0.03
        assert [model.unseen(one) for one in values[120:130]] == flagged[:10].tolist()


@pytest.mark.parametrize("frames", [1, 5, 24, 60])
def test_one_condition_of_few_frames_is_enough(drawn: Features, frames: int) -> None:
    model = _fit({"day": drawn["day"][:frames]})
    assert model.posterior(drawn["day"][0]) == {"day": 1.0}
    assert not model.unseen(drawn["day"][0])
    assert model.unseen(drawn["night"][0])


def test_a_feature_that_never_varies_does_no_harm(drawn: Features) -> None:
    flat = {name: np.hstack([values, np.zeros((240, 2), np.float32)]) for name, values in drawn.items()}
    model, plain = _fit(flat), _fit(drawn)
    assert np.array_equal(model.unseen_rows(flat["day"]), plain.unseen_rows(drawn["day"]))
    assert model.unseen(flat["day"][0] + np.array([*[0] * 6, 1, 0], np.float32))


def test_a_model_is_saved_without_objects(drawn: Features) -> None:
    model = _fit(drawn)
    file = io.BytesIO()
    np.savez(file, **model.to_arrays())  # type: ignore[arg-type]
    file.seek(0)
    read = ConditionModel.from_arrays(np.load(file, allow_pickle=False))
    assert read.conditions == model.conditions
    assert read.posterior(drawn["dusk"][3]) == model.posterior(drawn["dusk"][3])
    assert np.array_equal(read.unseen_rows(drawn["night"]), model.unseen_rows(drawn["night"]))


@pytest.mark.parametrize("name", ["conditions", "means", "precision", "limits"])
def test_damaged_arrays_are_refused(drawn: Features, name: str) -> None:
    arrays = _fit(drawn).to_arrays()
    with pytest.raises(CheckpointError, match="damaged"):
        ConditionModel.from_arrays({**arrays, name: arrays[name][:-1]})
    with pytest.raises(CheckpointError, match="damaged"):
        ConditionModel.from_arrays({key: value for key, value in arrays.items() if key != name})


@pytest.mark.parametrize(("shape", "conditions"), [((0, 3), []), ((2, 3), ["a"]), ((3,), ["a", "b", "c"])])
def test_features_that_make_no_model_are_refused(shape: tuple[int, ...], conditions: list[str]) -> None:
    with pytest.raises(DescriptorsError, match="one for each frame"):
        ConditionModel.fit(np.zeros(shape), conditions)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Features:
    out: Path = tmp_path_factory.mktemp("worlds") / "route"
    render_route(out, render_config({"places": 200, "size": (32, 64), "seed": 41}))
    return {
        drive.name: image_statistics(np.stack(list(decode_images(drive.paths, ImageSpec((32, 64), grey=False)))))
        for drive in open_route(out).traverses
    }


@pytest.mark.slow
def test_rendered_conditions_are_told_apart_at_other_places(rendered: Features) -> None:
    model = _fit(rendered, slice(0, 144))
    right, flagged = [], []
    for name in CONDITIONS:
        right += [max(a := model.posterior(one), key=a.__getitem__) == name for one in rendered[name][152:]]
        flagged.append(model.unseen_rows(rendered[name][152:]).mean())
    assert np.mean(right) > 0.95
    assert np.mean(flagged) <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize("left_out", ["autumn", "winter", "night", "rain"])
def test_rendered_conditions_not_seen_before_are_flagged(rendered: Features, left_out: str) -> None:
    # Spring and summer differ in the green of their leaves alone: each lies between the other's frames.
    model = _fit({name: values for name, values in rendered.items() if name != left_out}, slice(0, 144))
    assert model.unseen_rows(rendered[left_out][152:]).mean() > 0.5
    known = np.concatenate([model.unseen_rows(rendered[name][152:]) for name in CONDITIONS if name != left_out])
    assert known.mean() <= 0.02
