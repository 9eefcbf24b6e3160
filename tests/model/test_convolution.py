"""Convolutions: torch's own outputs and gradients to the bit, the small weight gradients in one thread."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode

from everplace.model.convolution import Convolution, TransposedConvolution

LAYERS: dict[str, tuple[type[nn.Conv2d | nn.ConvTranspose2d], type[nn.Conv2d | nn.ConvTranspose2d], dict[str, Any]]] = {
    "halving": (Convolution, nn.Conv2d, {"kernel_size": 3, "stride": 2, "padding": 1, "bias": False}),
    "at full size": (Convolution, nn.Conv2d, {"kernel_size": 3, "padding": 1, "bias": False}),
    "doubling": (TransposedConvolution, nn.ConvTranspose2d, {"kernel_size": 4, "stride": 2, "padding": 1}),
    "transposed at full size": (TransposedConvolution, nn.ConvTranspose2d, {"kernel_size": 3, "padding": 1}),
}


@pytest.fixture(params=[1, 2])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


class WeightGradients(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Notes in how many threads the gradients of weights are computed."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.threads: list[int] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if func is torch.ops.aten.convolution_backward.default and args[-1][1]:
            self.threads.append(torch.get_num_threads())
        return func(*args, **(kwargs or {}))


def pair(name: str) -> tuple[nn.Module, nn.Module]:
    """Our layer and torch's, of equal weights."""
    ours, theirs, options = LAYERS[name]
    with torch.random.fork_rng():
        torch.manual_seed(3)
        one, other = ours(16, 32, **options), theirs(16, 32, **options)
    other.load_state_dict(one.state_dict())
    return one, other


def step(layer: nn.Module, size: int = 16, *, autocast: bool = True, wants_input: bool = True) -> dict[str, Tensor]:
    """The output of a layer and all gradients of a random function of it."""
    generator = torch.Generator().manual_seed(5)
    x = torch.randn(8, 16, size, size, generator=generator, requires_grad=wants_input)
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=autocast):
        output = layer(x)
    wanted = torch.randn(output.shape, generator=generator)
    (output.float() * wanted).sum().backward()
    gradients = {name: parameter.grad for name, parameter in layer.named_parameters()} | {"x": x.grad}
    return {"output": output.detach()} | {name: of for name, of in gradients.items() if of is not None}


def require_equal(found: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    assert found.keys() == expected.keys()
    for name, value in found.items():
        assert value.dtype == expected[name].dtype, name
        assert torch.equal(value, expected[name]), name


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("wants_input", [True, False])
def test_in_one_thread_all_is_torchs_own_to_the_bit(name: str, wants_input: bool) -> None:
    ours, theirs = pair(name)
    require_equal(step(ours, wants_input=wants_input), step(theirs, wants_input=wants_input))


@pytest.mark.parametrize("name", LAYERS)
def test_without_bfloat16_all_is_torchs_own_however_many_threads(name: str, threads: int) -> None:
    ours, theirs = pair(name)
    require_equal(step(ours, autocast=False), step(theirs, autocast=False))


@pytest.mark.parametrize("name", LAYERS)
def test_small_weight_gradients_in_bfloat16_are_computed_in_one_thread(name: str, threads: int) -> None:
    with WeightGradients() as seen:
        step(pair(name)[0])
    assert seen.threads == [1]
    assert torch.get_num_threads() == threads


@pytest.mark.parametrize(("size", "autocast"), [(16, False), (256, True)])
def test_others_are_computed_in_all_threads(size: int, autocast: bool, threads: int) -> None:
    with WeightGradients() as seen:
        step(pair("at full size")[0], size, autocast=autocast)
    assert seen.threads == [threads]


@pytest.mark.parametrize("name", LAYERS)
def test_without_gradients_nothing_is_kept_for_them(name: str) -> None:
    ours, theirs = pair(name)
    with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16):
        x = torch.randn(2, 16, 8, 8)
        assert torch.equal(ours(x), theirs(x))
        assert ours(x).grad_fn is None


@pytest.mark.parametrize("name", LAYERS)
def test_the_weights_have_torchs_names_and_shapes(name: str) -> None:
    ours, theirs = ({key: value.shape for key, value in layer.state_dict().items()} for layer in pair(name))
    assert ours == theirs
