import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench.training import Muon, orthogonalise


def random(shape, seed=0):
    return torch.from_numpy(np.random.default_rng(seed).normal(size=shape).astype(np.float32))


@settings(max_examples=30, deadline=None)
@given(
    st.integers(1, 24),
    st.integers(1, 60),
    st.floats(1e-6, 1e6),
    st.integers(0, 100),
    st.sampled_from([torch.float32, torch.bfloat16]),
)
def test_directions_are_kept_and_their_sizes_made_equal(rows, columns, size, seed, dtype):
    matrix = random((rows, columns), seed) * size
    u, s, v = torch.linalg.svd(matrix, full_matrices=False)
    clear = s > 0.05 * s.norm()
    values = (u.T @ orthogonalise([matrix], dtype)[0] @ v.T).diagonal()[clear]
    assert ((values > 0.6) & (values < 1.3)).all()


def test_it_is_the_iteration_on_the_whole_matrix():
    x = matrix = random((12, 40))
    x = x / x.norm()
    for _ in range(5):
        square = x @ x.T
        x = 3.4445 * x + (-4.7750 * square + 2.0315 * square @ square) @ x
    torch.testing.assert_close(orthogonalise([matrix])[0], x, atol=1e-4, rtol=1e-3)
    torch.testing.assert_close(orthogonalise([matrix.T])[0], x.T, atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_matrices_do_not_mix(dtype):
    matrices = [random(shape, seed) for seed, shape in enumerate([(12, 40), (20, 12), (16, 16)])]
    for alone, found in zip(matrices, orthogonalise(matrices, dtype), strict=True):
        torch.testing.assert_close(found, orthogonalise([alone], dtype)[0], atol=1e-6, rtol=1e-5)


def test_nothing_comes_from_nothing():
    assert torch.equal(orthogonalise([torch.zeros(12, 20)])[0], torch.zeros(12, 20))


def one_step(weight, gradient, lr=0.1, decay=0.0):
    parameter = torch.nn.Parameter(weight.clone())
    parameter.grad = gradient
    Muon([{"params": [parameter], "weight_decay": decay}], lr=lr).step()
    return parameter.detach()


@pytest.mark.parametrize("shape", [(16, 32), (16, 4, 3, 3), (32, 16)])
def test_a_step_is_as_long_as_adams(shape):
    step = one_step(torch.zeros(shape), random(shape)) / 0.1
    assert 0.1 < float(step.square().mean().sqrt()) < 0.3


@pytest.mark.parametrize("shape", [(5,), (1, 20), (16, 1, 3, 3), (3, 64)])
def test_small_weights_step_as_with_adamw(shape):
    weights = torch.nn.Parameter(random(shape, 1)), torch.nn.Parameter(random(shape, 1))
    ours = Muon([{"params": [weights[0]], "weight_decay": 0.1}], lr=0.01)
    theirs = torch.optim.AdamW([weights[1]], lr=0.01, weight_decay=0.1)
    for seed in range(4):
        weights[0].grad, weights[1].grad = random(shape, seed), random(shape, seed)
        ours.step()
        theirs.step()
    torch.testing.assert_close(weights[0], weights[1])


def test_decay_shrinks_weights_beside_the_step():
    weight, gradient = random((16, 16), 1), random((16, 16), 2)
    plain, shrunk = one_step(weight, gradient), one_step(weight, gradient, decay=0.5)
    torch.testing.assert_close(shrunk - plain, -0.1 * 0.5 * weight)


def test_it_finds_the_least_squares_solution():
    wanted, data = random((12, 12), 3), random((200, 12), 4)
    weight = torch.nn.Parameter(torch.zeros(12, 12))
    optimiser = Muon([{"params": [weight]}], lr=0.2)
    for step in range(200):
        for group in optimiser.param_groups:
            group["lr"] = 0.2 * (1 - step / 200)
        optimiser.zero_grad()
        (data @ (weight - wanted).T).square().mean().backward()
        optimiser.step()
    assert float((weight - wanted).detach().abs().max()) < 0.02
