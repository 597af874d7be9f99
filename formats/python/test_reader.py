"""Compares farfield_asset.py with the Rust reader on random assets and points: `python3 formats/python/test_reader.py`.

Tolerance: the Rust reader computes in float32, this one in float64. In narrow lobes exponents carry the rounding of unit
vectors (1e-7) times up to 2·√(80·κ), so single values may differ by nearly 1e-3 of themselves; the mean must be far smaller.
"""
import pathlib
import subprocess
import tempfile
import unittest

import numpy as np

import farfield_asset

POINTS = 2000
CARGO = ["cargo", "run", "-q", "--release", "-p", "farfield-formats", "--example"]
ROOT = pathlib.Path(__file__).resolve().parents[2]
WORST = 1e-3
MEAN = 5e-6


def directions(random, grazing):
    """Half uniform over the hemisphere, half within a few degrees of the horizon where `grazing`."""
    z = random.uniform(0, 1, POINTS)
    z = np.where(grazing, 0.05 * z + 1e-3, z)
    phi = random.uniform(0, 2 * np.pi, POINTS)
    s = np.sqrt(1 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)


def points(seed):
    """x, n_c, wi, wo in float32 numbers; one n_c in two is that of the heights."""
    random = np.random.default_rng(seed)
    graze = random.integers(0, 4, POINTS)
    x = random.uniform(0, 1, (POINTS, 2))
    x[:64] = np.round(x[:64] * 64) / 64 % 1  # exactly on borders of cells and patches
    normal = directions(random, False) + [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[::2] = 0
    wi, wo = directions(random, graze & 1), directions(random, graze & 2)
    wo[::8] = wi[::8] * [-1, -1, 1]  # mirror directions, where the specular part peaks
    wi[0] = [0, 0, 1]
    return tuple(np.float32(a).astype(np.float64) for a in (x, normal, wi, wo))


class TheSpecificationAndTheRustReaderAgree(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        subprocess.run(CARGO + ["sample_assets", cls.folder.name], cwd=ROOT, check=True)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def compare(self, name, seed, worst=WORST):
        folder = pathlib.Path(self.folder.name, name)
        x, n_c, wi, wo = points(seed)
        lines = "\n".join(" ".join(map(repr, map(float, row))) for row in np.hstack([x, n_c, wi, wo]))
        run = subprocess.run(CARGO + ["evaluate", str(folder)], cwd=ROOT, check=True, input=lines, text=True, stdout=subprocess.PIPE)
        rust = np.array([line.split() for line in run.stdout.splitlines()], dtype=float)
        asset = farfield_asset.load(folder)
        level = asset["levels"][0]
        n_c[::2] = farfield_asset.normal_at(asset, level, x[::2])
        ours = np.hstack([farfield_asset.f_low(asset, level, x, n_c, wi, wo), farfield_asset.additive(asset, level, x, wi, wo)])
        self.assertEqual(rust.shape, ours.shape)
        self.assertTrue(np.isfinite(ours).all() and np.isfinite(rust).all())
        parts = rust.shape[1] if "additive" in level else 3
        self.assertGreater(np.count_nonzero(rust[:, :parts]), 0.9 * POINTS * parts)
        # Relative, but for values so far below a typical one that they are rounding of the scaling's sum.
        rust, ours = rust[:, :parts], ours[:, :parts]
        typical = [np.median(abs(ours[:, k - k % 3:k - k % 3 + 3])) for k in range(parts)]  # f_low's, the additive term's
        difference = abs(rust - ours) / (abs(ours) + 1e-6 * np.array(typical))
        print(f"{name}: {POINTS} points, difference {difference.mean():.1e} in the mean, {difference.max():.1e} at worst")
        self.assertLess(difference.max(), worst)
        self.assertLess(difference.mean(), MEAN)

    def test_color_rank2_repeat(self):
        self.compare("color_rank2_repeat", 1)

    def test_plain_rank1_clamp(self):
        self.compare("plain_rank1_clamp", 2)

    def test_diffuse_rank2_clamp(self):
        self.compare("diffuse_rank2_clamp", 3)

    def test_additive_repeat(self):
        # Narrow lobes seen from behind, f_low a thousandth of its median: three digits are left of a tail in float32.
        self.compare("additive_repeat", 5, worst=3e-3)

    def test_one_cell(self):
        self.compare("one_cell", 4)


class TheSpecificationAndTheRustReaderAgreeOnVolumes(unittest.TestCase):
    """float32 against float64 again: S has a condition of up to 1e4, and D holds the square of its inverse."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        subprocess.run(CARGO + ["sample_volumes", cls.folder.name], cwd=ROOT, check=True)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def compare(self, name, seed, filled):
        folder = pathlib.Path(self.folder.name, name)
        random = np.random.default_rng(seed)
        x = random.uniform(0, 1, (POINTS, 3))
        w, wi = (random.normal(size=(POINTS, 3)) for _ in range(2))
        w, wi = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (w, wi))
        x, w, wi = (np.float32(a).astype(np.float64) for a in (x, w, wi))
        x = np.minimum(x, np.float32(1) - np.finfo(np.float32).epsneg)
        lines = "\n".join(" ".join(map(repr, map(float, row))) for row in np.hstack([x, w, wi]))
        run = subprocess.run(CARGO + ["evaluate_volume", str(folder)], cwd=ROOT, check=True, input=lines, text=True, stdout=subprocess.PIPE)
        rust = np.array([line.split() for line in run.stdout.splitlines()], dtype=float)
        volume = farfield_asset.load_volume(folder)
        sigma_t, p = farfield_asset.flakes(volume["levels"][0], x, w, wi)
        ours = np.hstack([sigma_t[:, None], p])
        self.assertEqual(rust.shape, ours.shape)
        self.assertTrue(np.isfinite(ours).all() and np.isfinite(rust).all())
        np.testing.assert_array_equal(rust[:, 0] > 0, sigma_t > 0)
        self.assertGreater(np.count_nonzero(sigma_t), 0.9 * filled * POINTS)
        difference = abs(rust - ours) / np.where(ours > 0, ours, 1)
        print(f"{name}: {POINTS} points, difference {difference.mean():.1e} in the mean, {difference.max():.1e} at worst")
        self.assertLess(difference.max(), WORST)
        self.assertLess(difference.mean(), MEAN)

    def test_two_lobes(self):
        self.compare("two_lobes", 1, 0.3)

    def test_one_lobe_one_colour(self):
        self.compare("one_lobe_one_colour", 2, 0.3)

    def test_three_lobes_full(self):
        self.compare("three_lobes_full", 3, 0.7)

    def test_one_voxel(self):
        self.compare("one_voxel", 4, 1)


if __name__ == "__main__":
    unittest.main()
