"""Networks from hub repositories: real torch.hub on directories and on its own cache, without a network."""

from __future__ import annotations

import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from everplace.describe.registry import open_describer
from everplace.errors import DescriptorsError, InputError, MethodError
from everplace.images.decoding import ImageSpec
from everplace.route.route import open_route

HUBCONF = '''
dependencies = ["torch"]
from pathlib import Path

from layers import MeanColour
from torch import nn

(Path(__file__).parent / "was_run").touch()

def mean_colour(scale=1.0, repeat=1, name=""):
    """Three numbers an image, `repeat` times."""
    print("loading", name)
    return MeanColour(scale, repeat)

class Wrapped(nn.Module):
    def __init__(self, wrap):
        super().__init__()
        self.wrap = wrap
    def forward(self, x):
        return self.wrap(x)

def dictionary(): return Wrapped(lambda x: {"descriptor": x.mean((2, 3))})
def several(): return Wrapped(lambda x: (x.mean((2, 3)), x))
def listed(): return Wrapped(lambda x: [x.mean((2, 3)), x, "attentions"])
def alone(): return Wrapped(lambda x: (x.mean((2, 3)),))
def later(): return Wrapped(lambda x: ("attentions", x.mean((2, 3))))
def none(): return Wrapped(lambda x: ())
def maps(): return Wrapped(lambda x: (x, x.mean((2, 3))))
def map(): return Wrapped(lambda x: x[:, :, :2, :2])
def squeezed(): return Wrapped(lambda x: x.mean((2, 3)).squeeze(0))
def integers(): return Wrapped(lambda x: x.mean((2, 3)).long())
def picky(): return nn.Sequential(nn.Flatten(), nn.Linear(3 * 8 * 8, 4))
def changing(): return Wrapped(lambda x: x.flatten(1)[:, : 2 + len(x)])
def nothing(): return 7
def broken(): raise ValueError("no such backbone\\nsecond line")
def asking(): return input("trust?")
def incomplete():
    import a_package_that_is_not_there
'''
LAYERS = """
import torch
from torch import nn

class MeanColour(nn.Module):
    def __init__(self, scale, repeat):
        super().__init__()
        self.scale = nn.Parameter(torch.tensor(float(scale)))
        self.repeat = repeat
    def forward(self, x):
        return (self.scale * x.mean((2, 3))).repeat(1, self.repeat) + OFFSET

OFFSET = 0
"""


def write_repository(directory: Path, layers: str = LAYERS, hubconf: str = HUBCONF) -> Path:
    directory.mkdir(parents=True)
    (directory / "hubconf.py").write_text(hubconf)
    (directory / "layers.py").write_text(layers)
    return directory


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    return write_repository(tmp_path / "means")


def batch(frames: int, height: int = 224, width: int = 224) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (frames, height, width, 3), dtype=np.uint8)


def test_a_local_network_describes_with_imagenet_normalisation(repository: Path) -> None:
    describer = open_describer(f"hub:{repository}:mean_colour")
    assert (describer.method, describer.dimension, describer.metric) == ("hub:means:mean_colour", 3, "cosine")
    assert describer.image == ImageSpec((224, 224))
    images = batch(3)
    mean = images.astype(np.float64).mean(axis=(1, 2)) / 255
    expected = (mean - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    assert np.allclose(describer.describe_batch(images), expected, atol=1e-4)


def test_arguments_go_to_the_entry_and_options_to_the_images(
    repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    describer = open_describer(
        f"hub:{repository}:mean_colour?scale=2.5&repeat=2&name=a%26b#size=32x48&mean=0&std=0.5/0.25/1"
    )
    assert describer.image == ImageSpec((32, 48))
    assert describer.dimension == 6
    images = batch(2, 32, 48)
    expected = 2.5 * images.astype(np.float64).mean(axis=(1, 2)) / 255 / [0.5, 0.25, 1.0]
    assert np.allclose(describer.describe_batch(images), np.tile(expected, 2), atol=1e-4)
    out, err = capsys.readouterr()
    assert out == ""  # results belong there
    assert "loading a&b" in err
    settings = describer.settings()
    assert settings["arguments"] == '{"name": "a&b", "repeat": 2, "scale": 2.5}'
    assert (settings["height"], settings["mean"], settings["std"]) == (32, "0.0", "0.5 0.25 1.0")


def test_a_traverse_is_described(repository: Path, tiny_route: Path) -> None:
    describer = open_describer(f"hub:{repository}:mean_colour#size=32x64")
    described = describer.describe(open_route(tiny_route)["winter"])
    assert described.values.shape == (12, 3)
    assert described.settings == describer.settings()


def test_settings_tell_weights_and_code_apart(tmp_path: Path, repository: Path) -> None:
    first = open_describer(f"hub:{repository}:mean_colour").settings()
    assert open_describer(f"hub:{repository}:mean_colour").settings() == first
    other_weights = open_describer(f"hub:{repository}:mean_colour?scale=2").settings()
    assert other_weights["weights"] != first["weights"]
    assert other_weights["code"] == first["code"]
    changed = write_repository(tmp_path / "elsewhere" / "means", LAYERS.replace("OFFSET = 0", "OFFSET = 1"))
    other_code = open_describer(f"hub:{changed}:mean_colour").settings()
    assert other_code["code"] != first["code"]
    assert other_code["weights"] == first["weights"]


def test_two_repositories_may_have_modules_of_one_name(tmp_path: Path, repository: Path) -> None:
    other = write_repository(tmp_path / "other", LAYERS.replace("OFFSET = 0", "OFFSET = 100"))
    path, modules = list(sys.path), set(sys.modules)
    near, far = (open_describer(f"hub:{one}:mean_colour") for one in (repository, other))
    images = batch(1)
    assert np.allclose(far.describe_batch(images) - near.describe_batch(images), 100, atol=1e-3)
    assert sys.path == path
    assert "layers" not in set(sys.modules) - modules


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        ("dictionary", "returned a dict instead of one tensor"),
        ("later", "returned a str instead of one tensor"),
        ("none", "returned a tuple instead of one tensor"),
        ("maps", r"returned a tensor of shape \(1, 3, 224, 224\) for 1 images instead of one row an image"),
        ("map", r"returned a tensor of shape \(1, 3, 2, 2\) for 1 images instead of one row an image"),
        ("squeezed", r"returned a tensor of shape \(3,\) for 1 images"),
        ("integers", r"returned a tensor of torch\.int64 instead of one tensor of floating-point"),
        ("picky", "fails on an image of 224×224: .*; try another size"),
        ("nothing", "nothing of means is no network: it returned a int"),
        ("broken", "broken of means cannot be loaded: ValueError: no such backbone; see its hubconf.py"),
        ("asking", "cannot be loaded: it asks a question"),
        ("incomplete", "it needs a_package_that_is_not_there, not installed here; pip install a_package_that_is_not"),
        ("absent", "Cannot find callable absent in hubconf; see its hubconf.py for the entries"),
        ("mean_colour?colour=1", "unexpected keyword argument 'colour'"),
        ("mean_colour?scale", "'scale' is no KEY=VALUE"),
        ("mean_colour?scale=1&scale=2", "'scale' is given twice"),
        ("mean_colour#sise=2x2", "unknown option 'sise' after #; known: mean, size, std"),
        ("mean_colour#size=224", "size=224 is no size; write HxW"),
        (f"mean_colour#size={'9' * 5000}x8", "is no size; write HxW"),
        ("mean_colour#size=0x10", "image size 0×10 is not possible"),
        ("mean_colour#mean=1/2", "mean=1/2 must be one number, or three"),
        ("mean_colour#std=0", "std not 0"),
        ("", "names no entry; write hub:OWNER/REPO:ENTRY"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(repository: Path, rest: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        open_describer(f"hub:{repository}:{rest}")
    assert "\n" not in str(caught.value)


def test_a_dimension_that_changes_is_refused(repository: Path) -> None:
    describer = open_describer(f"hub:{repository}:changing#size=8x8")
    with pytest.raises(DescriptorsError, match=r"returned an array of shape \(3, 5\), not \(3, 3\)"):
        describer.describe(list(batch(3, 8, 8)))


def test_a_missing_dependency_is_named(tmp_path: Path) -> None:
    hubconf = HUBCONF.replace('["torch"]', '["torch", "a_missing_package"]')
    repository = write_repository(tmp_path / "r", hubconf=hubconf)
    with pytest.raises(
        MethodError, match="it needs a_missing_package, not installed here; pip install a_missing_package"
    ):
        open_describer(f"hub:{repository}:mean_colour")


def test_directories_without_hubconf_and_other_addresses_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MethodError, match=r"is no hub repository: it holds no hubconf\.py"):
        open_describer(f"hub:{tmp_path}:net")
    for address in ("cosplace", "a/b/c", "a b/c", "https://github.com/a/b"):
        with pytest.raises(MethodError, match="is no hub repository; write OWNER/REPO"):
            open_describer(f"hub:{address}:net")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """torch.hub's cache as a download leaves it, and no way to the net."""
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    monkeypatch.delenv("EVERPLACE_TRUST_HUB", raising=False)
    monkeypatch.setattr(urllib.request, "_opener", None)  # it keeps the proxies that it was made with
    for variable in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"):
        monkeypatch.setenv(variable, "http://127.0.0.1:9")
    assert torch.hub.get_dir() == str(tmp_path / "torch" / "hub")
    return tmp_path / "torch" / "hub"


@pytest.mark.parametrize(("branch", "ref"), [("main", ""), ("master", ""), ("v1.2", ":v1.2")])
def test_code_from_the_net_runs_only_after_the_user_has_named_it(
    cache: Path, monkeypatch: pytest.MonkeyPatch, branch: str, ref: str
) -> None:
    directory = write_repository(cache / f"some_means_{branch}")
    method = f"hub:some/means{ref}:mean_colour"
    with pytest.raises(
        MethodError, match="would run code from https://github.com/some/means .*EVERPLACE_TRUST_HUB=some/me"
    ):
        open_describer(method)
    assert not (directory / "was_run").exists()
    monkeypatch.setenv("EVERPLACE_TRUST_HUB", "a/b,some/means")
    assert open_describer(method).method == f"hub:some/means{ref}:mean_colour"
    assert (directory / "was_run").exists()
    monkeypatch.delenv("EVERPLACE_TRUST_HUB")
    assert open_describer(method).dimension == 3  # torch.hub has noted it


def test_a_repository_that_cannot_be_downloaded_is_one_sentence(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVERPLACE_TRUST_HUB", "some/absent")
    for method in ("hub:some/absent:net", "hub:some/absent:v1:net"):
        with pytest.raises(MethodError, match="check the network, or clone the repository and give its directory"):
            open_describer(method)


@pytest.mark.parametrize("entry", ["several", "listed", "alone"])
def test_the_first_part_of_what_a_network_returns_is_the_descriptor(
    repository: Path, tiny_route: Path, entry: str
) -> None:
    frames = open_route(tiny_route)["summer"]
    described = open_describer(f"hub:{repository}:{entry}#size=8x8").describe(frames)
    mean = open_describer(f"hub:{repository}:mean_colour#size=8x8").describe(frames)
    assert described.dimension == 3
    np.testing.assert_allclose(described.values, mean.values, atol=1e-5)
