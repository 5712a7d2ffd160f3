"""Noise of residuals: the filter against the dense Gaussian it stands for."""

from dataclasses import replace

import numpy as np
import pytest

from bench.diagnosis.joint.fit import ENOUGH
from bench.diagnosis.noise import (
    CLIP,
    LONGEST_MEMORY_S,
    SHORTEST_MEMORY_S,
    Block,
    Noise,
    calm,
    cost,
    estimate,
    huber,
    whiten,
)

NOISES = [
    Noise(1.0, 0.0, 0.1),
    Noise(0.3, 1.0, 0.05),
    Noise(1.0, 2.0, 0.3),
    Noise(0.01, 1.0, 0.02),
]


def covariance(t_s, noise, extra):
    apart = np.abs(t_s[:, None] - t_s[None, :])
    return noise.coloured**2 * np.exp(-apart / noise.memory_s) + np.diag(noise.white**2 + extra)


def drawn(noise, count=150, seed=1, pace_s=0.01):
    """A block of this very noise, at uneven times, some samples less sure than others."""
    random = np.random.default_rng(seed)
    t_s = np.cumsum(random.uniform(0.2, 1.8, count)) * pace_s
    extra = np.where(random.random(count) < 0.2, 0.5, 0.0) * noise.white**2
    slow = noise.coloured * random.normal()
    value = np.sqrt(noise.white**2 + extra) * random.normal(size=count)
    value[0] += slow
    for k in range(1, count):
        keep = np.exp(-(t_s[k] - t_s[k - 1]) / noise.memory_s)
        slow = keep * slow + noise.coloured * np.sqrt(1.0 - keep**2) * random.normal()
        value[k] += slow
    return Block(t_s, value, extra)


@pytest.mark.parametrize("noise", NOISES)
def test_the_cost_is_that_of_the_dense_gaussian(noise):
    block = drawn(noise)
    z, logs = whiten(block, noise, block.value[:, None])
    assert np.abs(z).max() < CLIP  # so that no sample is taken for an outlier
    dense = covariance(block.t_s, noise, block.extra)
    _, logdet = np.linalg.slogdet(dense)
    square = block.value @ np.linalg.solve(dense, block.value)
    assert float((z**2).sum()) == pytest.approx(square)
    assert logs == pytest.approx(0.5 * logdet)
    assert cost(block, noise) == pytest.approx(0.5 * square + 0.5 * logdet)


def swayed(noise, seed=4):
    """A block that some waves of unknown height go through, one of them long, one hardly there."""
    block = drawn(noise)
    random = np.random.default_rng(seed)
    heights = np.array([2.0, 0.3, 1e-9]) * noise.total
    sways = heights * np.sin(np.outer(block.t_s, [3.0, 11.0, 5.0]))
    return replace(block, value=block.value + sways @ random.normal(size=3), sways=sways)


def test_scatter_is_all_that_is_known_and_what_lasts_can_be_taken_away():
    rows = np.repeat([0, 1], [4, 3])
    sways = np.array([2.0, 3.0]) * (rows[:, None] == np.arange(2))
    value = np.array([1.0, 2.0, 3.0, 2.0, 9.0, 9.0, 12.0])
    block = Block(np.arange(7.0), value, np.full(7, 0.5), sways)
    assert block.scatter == pytest.approx(np.where(rows == 0, 4.5, 9.5))
    assert block.apart() == pytest.approx([-1.0, 0.0, 1.0, 0.0, -1.0, -1.0, 2.0])
    bare = replace(block, sways=None)
    assert bare.scatter is bare.extra
    assert bare.apart() is value


@pytest.mark.parametrize("noise", NOISES)
def test_what_sways_a_block_is_summed_over_as_in_the_dense_gaussian(noise):
    block = swayed(noise)
    z, logs = whiten(block, noise, block.value[:, None])
    assert np.abs(z).max() < CLIP
    dense = covariance(block.t_s, noise, block.extra) + block.sways @ block.sways.T
    _, logdet = np.linalg.slogdet(dense)
    square = block.value @ np.linalg.solve(dense, block.value)
    assert float((z**2).sum()) == pytest.approx(square)
    assert logs == pytest.approx(0.5 * logdet)
    assert cost(block, noise) == pytest.approx(0.5 * square + 0.5 * logdet)


@pytest.mark.parametrize("noise", NOISES)
def test_what_most_likely_swayed_a_block_is_as_the_dense_gaussian_has_it(noise):
    block = swayed(noise)
    bare = covariance(block.t_s, noise, block.extra)
    both = bare + block.sways @ block.sways.T
    likely = block.sways @ block.sways.T @ np.linalg.solve(both, block.value)
    assert calm(block, noise).value == pytest.approx(block.value - likely)


@pytest.mark.parametrize("noise", NOISES)
def test_whitening_is_linear(noise):
    block = drawn(noise)
    a, b = np.random.default_rng(2).normal(size=(2, len(block.value)))
    columns, _ = whiten(block, noise, np.stack([a, b, 3.0 * a - 0.5 * b], axis=1))
    assert columns[:, 2] == pytest.approx(3.0 * columns[:, 0] - 0.5 * columns[:, 1])


@pytest.mark.parametrize("noise", NOISES)
def test_whitened_noise_is_white(noise):
    block = drawn(noise, 3000)
    z = whiten(block, noise, block.value[:, None])[0][:, 0]
    few = 4.0 / np.sqrt(len(z))  # four deviations of what is asked for
    assert abs(z.mean()) < few
    assert z.var() == pytest.approx(1.0, abs=few * np.sqrt(2.0))
    assert abs(np.mean(z[1:] * z[:-1])) < few


def test_an_outlier_costs_no_more_than_linearly():
    z = np.array([0.5 * CLIP, CLIP, 10.0 * CLIP, 20.0 * CLIP])
    costs = huber(z)
    assert costs[:2] == pytest.approx(0.5 * z[:2] ** 2)
    assert costs[3] - costs[2] == pytest.approx(10.0 * CLIP**2)
    assert (huber(-z) == costs).all()


@pytest.mark.parametrize("noise", NOISES)
def test_a_block_costs_what_its_innovations_cost_and_their_deviations(noise):
    block = drawn(noise)
    block.value[::50] *= 20.0
    z, logs = whiten(block, noise, block.value[:, None])
    assert np.abs(z).max() > CLIP
    assert cost(block, noise) == pytest.approx(huber(z).sum() + logs)


@pytest.mark.parametrize("noise", [Noise(0.3, 1.0, 0.05), Noise(1.0, 2.0, 0.3)])
def test_the_estimate_is_the_noise_that_made_the_data(noise):
    """Within four deviations of the mean of sets like it."""
    sets = [[drawn(noise, 500, 100 * s + k) for k in range(2)] for s in range(8)]
    found = [estimate(blocks, 0.05 * noise.white) for blocks in sets]
    for word in ("white", "coloured", "memory_s"):
        logs = np.log([getattr(one, word) for one in found])
        error = np.std(logs, ddof=1) / np.sqrt(len(logs))
        assert np.mean(logs) == pytest.approx(np.log(getattr(noise, word)), abs=4.0 * error)
        assert error < 0.1


def test_white_noise_comes_out_as_white():
    random = np.random.default_rng(5)
    t_s = np.arange(800) * 0.01
    found = estimate([Block(t_s, 2.0 * random.normal(size=800), np.zeros(800))], 0.1)
    assert found.total == pytest.approx(2.0, rel=0.1)
    # what is left to colour has no memory worth the name at this pace
    kept = found.coloured**2 * np.exp(-0.01 / found.memory_s)
    assert kept < 0.1 * found.total**2


@pytest.mark.parametrize("size", [1e-6, 0.5])
def test_the_white_part_is_never_below_the_floor(size):
    random = np.random.default_rng(6)
    t_s = np.arange(200) * 0.01
    found = estimate([Block(t_s, size * random.normal(size=200), np.zeros(200))], 1.0)
    assert found.white >= 1.0 - 1e-9
    assert found.memory_s * (1.0 + 1e-9) >= SHORTEST_MEMORY_S
    assert found.memory_s <= LONGEST_MEMORY_S * (1.0 + 1e-9)


def test_no_estimate_is_beaten_by_one_from_another_start():
    for seed in range(1, 9):
        block = drawn(NOISES[1], 400, seed)
        found = cost(block, estimate([block], 0.01))
        assert cost(block, estimate([block], 0.01, NOISES[1])) > found - ENOUGH


@pytest.mark.parametrize("factor", [0.7, 0.95, 1.05, 1.4])
def test_no_neighbour_is_likelier_than_the_estimate(factor):
    block = drawn(NOISES[1], 400, seed=2)
    found = estimate([block], 0.01)
    for other in (
        Noise(found.white * factor, found.coloured, found.memory_s),
        Noise(found.white, found.coloured * factor, found.memory_s),
        Noise(found.white, found.coloured, found.memory_s * factor),
    ):
        assert cost(block, other) > cost(block, found)


def test_a_coloured_part_is_found_beside_a_known_variance_that_is_far_greater():
    """Most of what is seen is known; what is left is a little, and lasts."""
    floor, coloured, memory_s = 3e-4, 2e-4, 0.38
    random = np.random.default_rng(3)
    blocks = []
    for _ in range(4):
        t_s = 0.005 * np.arange(1000)
        extra = np.where(np.sin(3.0 * t_s) > 0.0, 2e-3, 1e-5) ** 2
        keep = np.exp(-0.005 / memory_s)
        slow = np.empty(1000)
        slow[0] = coloured * random.normal()
        for k in range(1, 1000):
            slow[k] = keep * slow[k - 1] + coloured * np.sqrt(1 - keep**2) * random.normal()
        white = np.sqrt(extra + floor**2) * random.normal(size=1000)
        blocks.append(Block(t_s, slow + white, extra))
    found = estimate(blocks, floor)
    true = Noise(floor, coloured, memory_s)
    assert sum(cost(b, found) for b in blocks) < sum(cost(b, true) for b in blocks)
    assert found.coloured == pytest.approx(coloured, rel=0.3)
    gone = Noise(floor, 1e-3 * floor, 0.5)
    assert estimate(blocks, floor, gone).coloured == pytest.approx(found.coloured, rel=0.05)
