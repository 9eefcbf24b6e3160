"""Any descriptor network that torch.hub can load, the way modern methods are published.

    hub:OWNER/REPO[:REF]:ENTRY[?ARGUMENT=VALUE&...][#OPTION=VALUE&...]
    hub:DIRECTORY:ENTRY...                              a clone; begins with /, . or ~

For example CosPlace (Berton, Masone and Caputo, "Rethinking Visual Geo-localization for Large-Scale Applications",
CVPR 2022), 512 numbers, 2,048 bytes a descriptor:

    hub:gmberton/cosplace:get_trained_model?backbone=ResNet18&fc_output_dim=512#size=512x512

The arguments go to the entry: numbers, true, false and null as in JSON, else text. The options say how images are
prepared: `size` HxW (224x224), `mean` and `std` of values in [0, 1], one number or three separated by / (ImageNet's).
The network takes B×3×H×W and returns B×D, alone or first in a tuple; descriptors are compared by cosine. Its code runs
on this machine: a repository on GitHub must be named in EVERPLACE_TRUST_HUB at its first use.
"""

from __future__ import annotations

import json
import re
from urllib.parse import unquote

from everplace.describe.pretrained.hub_repository import load_network, parse_repository
from everplace.describe.pretrained.network import NetworkDescriber
from everplace.describe.pretrained.network_input import IMAGENET, Normalisation
from everplace.errors import ConfigError

__all__ = ["open_method"]

NOTES = (
    (
        "hub:OWNER/REPO:ENTRY",
        "any descriptor network that torch.hub can load, or hub:DIRECTORY:ENTRY of a clone; quote it for the shell",
        "EVERPLACE_TRUST_HUB=OWNER/REPO at its first use, as its code runs here, and a download",
        None,
    ),
    (
        "hub:gmberton/cosplace:get_trained_model?backbone=ResNet50&fc_output_dim=2048#size=512x512",
        "CosPlace (Berton et al., CVPR 2022)",
        "EVERPLACE_TRUST_HUB=gmberton/cosplace",
        2048,
    ),
    (
        "hub:gmberton/eigenplaces:get_trained_model?backbone=ResNet50&fc_output_dim=2048#size=512x512",
        "EigenPlaces (Berton et al., ICCV 2023)",
        "EVERPLACE_TRUST_HUB=gmberton/eigenplaces",
        2048,
    ),
    (
        "hub:serizba/salad:dinov2_salad#size=322x322",
        "DINOv2 SALAD (Izquierdo and Civera, CVPR 2024)",
        "EVERPLACE_TRUST_HUB=serizba/salad",
        8448,
    ),
    (
        "hub:amaralibey/Bag-of-Queries:get_trained_boq?backbone_name=resnet50&output_dim=16384#size=384x384",
        "BoQ with ResNet50 (Ali-bey et al., CVPR 2024)",
        "EVERPLACE_TRUST_HUB=amaralibey/Bag-of-Queries",
        16384,
    ),
    (
        "hub:amaralibey/Bag-of-Queries:get_trained_boq?backbone_name=dinov2&output_dim=12288#size=322x322",
        "BoQ with DINOv2 (Ali-bey et al., CVPR 2024)",
        "EVERPLACE_TRUST_HUB=amaralibey/Bag-of-Queries",
        12288,
    ),
    (
        "hub:gmberton/MegaLoc:get_trained_model#size=322x322",
        "MegaLoc (Berton and Masone, 2025)",
        "EVERPLACE_TRUST_HUB=gmberton/MegaLoc",
        8448,
    ),
)

_OPTIONS = ("mean", "size", "std")


def open_method(argument: str) -> NetworkDescriber:
    """Loads the network and describes one grey image with it, which tells its dimension.

    Raises:
        ConfigError: The address is no hub:OWNER/REPO:ENTRY, or an option of it is wrong.
        MethodError: The repository is not trusted or cannot be loaded, or the network does not give one row an image.
    """
    address, _, options_text = argument.partition("#")
    target, _, arguments_text = address.partition("?")
    where, _, entry = target.rpartition(":")
    if not where or not entry:
        raise ConfigError(f"hub:{argument} names no entry; write hub:OWNER/REPO:ENTRY or hub:DIRECTORY:ENTRY")
    repository = parse_repository(where)
    options = _pairs(options_text)
    unknown = sorted(set(options) - set(_OPTIONS))
    if unknown:
        raise ConfigError(f"hub:{argument}: unknown option {unknown[0]!r} after #; known: {', '.join(_OPTIONS)}")
    size = _size(options.get("size", "224x224"))  # a multiple of 14 and of 32, as patches and strides mostly want it
    mean = _channels(options["mean"], "mean") if "mean" in options else IMAGENET.mean
    std = _channels(options["std"], "std") if "std" in options else IMAGENET.std
    normalisation = Normalisation(mean, std)
    arguments = {key: _value(text) for key, text in _pairs(arguments_text).items()}
    network, identity = load_network(repository, entry, arguments)
    return NetworkDescriber(
        f"hub:{repository.label}:{entry}",
        network,
        size=size,
        normalisation=normalisation,
        settings={"arguments": json.dumps(arguments, sort_keys=True), **identity},
        batch=8,
    )


def _pairs(text: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for part in filter(None, text.split("&")):
        key, equals, value = part.partition("=")
        if not equals or not key:
            raise ConfigError(f"{part!r} is no KEY=VALUE; separate several by &, and quote the whole for the shell")
        if key in pairs:
            raise ConfigError(f"{key!r} is given twice; keep one")
        pairs[key] = unquote(value)
    return pairs


def _value(text: str) -> object:
    try:
        return json.loads({"True": "true", "False": "false", "None": "null"}.get(text, text))
    except ValueError:
        return text


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch("([0-9]{1,9})x([0-9]{1,9})", text)
    if found is None:
        raise ConfigError(f"size={text} is no size; write HxW in pixels, such as size=480x640")
    return int(found[1]), int(found[2])


def _channels(text: str, name: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split("/"))
    except ValueError:
        values = ()
    if len(values) not in {1, 3}:
        raise ConfigError(f"{name}={text} must be one number, or three separated by /, such as {name}=0.5/0.5/0.5")
    return values
