"""Renders one displaced plane under one light with farfield and with Mitsuba 3, and compares the means of the images.

    python tests/mitsuba/compare.py [--farfield PATH] [--samples N] [--skip-checks]

Exits with 1 if a mean differs by more than 1 %, with 2 if the comparison could not tell. See README.md beside it.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time


def choose_llvm():
    """Points Mitsuba to the Rust toolchain's LLVM unless another is asked for: LLVM 15, as many systems have, fails."""
    try:
        sysroot = subprocess.run(["rustc", "--print", "sysroot"], check=True, capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return
    for library in pathlib.Path(sysroot.strip(), "lib").glob("libLLVM.*"):
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))


# before the imports, which load it; and `tile` after the variant, whose types it takes
choose_llvm()
import drjit as dr  # noqa: E402
import mitsuba as mi  # noqa: E402
import numpy as np  # noqa: E402

mi.set_variant("llvm_ad_rgb")

from tile import OFFSET, Tile  # noqa: E402

# Exit codes.
AGREES, DIFFERS, CANNOT_TELL = range(3)

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Largest relative difference of the means of two images.
LIMIT = 0.01
# Largest standard error of that difference, and largest change by a choice made here: the limit is to mean something.
RESOLUTION = LIMIT / 4

MAP = "twill"
# Metres covered by the map along u and v, 1024 texels of 1 mm.
PERIOD = 1.024
# Tiles along each axis in farfield's scene; even, so that the world's origin is a corner of one.
TILES = 100
# Pixels of the film. It is one period wide, and its height over its width is the cosine between view and normal: it
# shows one period of the plane, whole. 39.6 degrees.
FILM = (200, 154)
COS_VIEW = FILM[1] / FILM[0]
# Angle from the normal and azimuth from x towards z of the light, degrees: out of the plane of the view.
LIGHT = (55.0, 30.0)
# On a plane that faces the light.
IRRADIANCE = float(np.pi)

ALBEDO = 0.5
ROUGHNESS = 0.3
F0 = 0.9

# Cuts of a cell along each axis; see the checks for what they leave.
CUT = 2
# Metres by which Mitsuba's `spawn_ray` moves a ray at the far side of the tile: 1500 units of single precision times
# 1 + |x|. Not used but to show what it would do.
SPAWN_OFFSET = 1500 * 2.0**-24 * (1 + PERIOD)
# Bounces before Russian roulette, as in farfield, and the largest chance to go on.
SURE_BOUNCES = 3
MAX_SURVIVAL = 0.95
# Samples a pixel that are followed together.
PASS = 16
SEED = 1


def main():
    """Compares; the exit code."""
    options = arguments()
    heights, amplitude = height_map()
    started = time.monotonic()
    tile = Tile(heights, PERIOD / heights.shape[1], CUT)
    print(f"{'base':<12}{'integrator':<12}{'farfield':>20}{'Mitsuba':>20}{'difference':>18}{'z of pixels':>13}")
    codes = []
    with tempfile.TemporaryDirectory() as folder:
        write_manifest(pathlib.Path(folder), amplitude)
        cases = [(Diffuse(), "direct"), (Diffuse(), "path"), (Conductor(), "direct"), (Conductor(), "path")]
        for material, integrator in cases:
            ours = farfield_image(options, pathlib.Path(folder), material.name, integrator)
            theirs = mitsuba_image(tile, material, integrator, options.samples)
            codes.append(compare(material.name, integrator, ours, theirs))
    print(f"{tile.followed} rays of Mitsuba, {tile.leaked} of them lost below the surface")
    if not options.skip_checks:
        codes.append(checks(heights, options.samples))
    print(f"{time.monotonic() - started:.0f} s")
    return DIFFERS if DIFFERS in codes else max(codes)


def arguments():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--farfield", default=ROOT / "target/release/farfield", help="the program")
    parser.add_argument("--samples", type=int, default=64, help="a pixel, in either renderer; a multiple of 16")
    parser.add_argument("--skip-checks", action="store_true", help="the comparison alone")
    options = parser.parse_args()
    if not pathlib.Path(options.farfield).is_file():
        parser.error(f"`{options.farfield}` is not there; wanted the program: `cargo build --release`, or `--farfield`")
    if options.samples < PASS or options.samples % PASS:
        parser.error(f"`--samples` is {options.samples}; wanted a multiple of {PASS}")
    return options


def height_map():
    """Heights of the map in metres, `[v][u]`, and its amplitude in metres."""
    facts = json.loads((ROOT / "fixtures/heights/heights.json").read_text())[MAP]
    codes = np.array(mi.Bitmap(str(ROOT / "fixtures" / facts["file"]))).squeeze()
    amplitude = facts["amplitude_texels"] * PERIOD / codes.shape[1]
    return codes / np.float64(np.iinfo(codes.dtype).max) * amplitude, amplitude


def light_direction():
    """To the light, in the world."""
    theta, phi = np.radians(LIGHT)
    return np.array([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)])


# --- farfield


def write_manifest(folder, amplitude):
    """One surface and one scene a base BRDF."""
    bases = {
        "diffuse": f'{{ type = "diffuse", albedo = {[ALBEDO] * 3} }}',
        "conductor": f'{{ type = "conductor", roughness = {ROUGHNESS}, specular = {[F0] * 3} }}',
    }
    position = [0.0, COS_VIEW, float(np.sqrt(1 - COS_VIEW**2))]
    lines = []
    for name, base in bases.items():
        lines += [
            f"[surface.{name}]",
            f"height = {json.dumps(str(ROOT / 'fixtures/heights' / MAP) + '.png')}",
            f"size = [{PERIOD}, {PERIOD}]",
            f"amplitude = {amplitude!r}",
            "levels = [8]",
            f"bsdf = {base}",
            f"[scene.{name}]",
            f"camera = {{ position = {position}, target = [0, 0, 0], width = {PERIOD} }}",
            f"film = {{ width = {FILM[0]}, height = {FILM[1]} }}",
            f'lights = [ {{ type = "directional", direction = {light_direction().tolist()}, '
            f"irradiance = {[IRRADIANCE] * 3} }} ]",
            f'objects = [ {{ mesh = "plane", surface = "{name}", tiling = [{TILES}, {TILES}] }} ]',
        ]
    (folder / "farfield.toml").write_text("\n".join(lines) + "\n")


def farfield_image(options, folder, scene, integrator):
    """farfield's image of a scene of the manifest."""
    output = folder / f"{scene}_{integrator}.exr"
    command = [options.farfield, "render", scene, "--manifest", folder / "farfield.toml", "--model", "full"]
    command += ["--integrator", integrator, "--spp", str(options.samples), "--quiet", "--output", output]
    if subprocess.run([str(word) for word in command]).returncode != 0:
        sys.exit(CANNOT_TELL)
    bitmap = mi.Bitmap(str(output))
    names = [field.name for field in bitmap.struct_()]
    channels = dict(zip(names, np.moveaxis(np.array(bitmap).astype(np.float64), -1, 0)))
    return Image(channels["R"], channels["variance.R"])


# --- Mitsuba


class Diffuse:
    """Mitsuba's diffuse BSDF."""

    name = "diffuse"

    def __init__(self):
        self.bsdf = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": ALBEDO}})

    def reflect(self, wi, wo):
        """BRDF times cosine, 1/sr, for light from `wi` seen from `wo`, both in the frame of the normal."""
        return self.bsdf.eval(mi.BSDFContext(), self._seen_from(wo), wi)[0]

    def bounce(self, wo, random):
        """A direction to the light and BRDF times cosine over its density."""
        u = mi.Point2f(random(dr.width(wo)), random(dr.width(wo)))
        sample, weight = self.bsdf.sample(mi.BSDFContext(), self._seen_from(wo), mi.Float(0), u)
        return sample.wo, weight[0]

    def _seen_from(self, wo):
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(wo))
        si.wi = wo
        return si


class Conductor:
    """GGX normals of Mitsuba with Schlick's Fresnel term and height-correlated shadowing, as in farfield.

    Mitsuba's own shadowing is the product of both Smith terms; with `separable` that is taken instead.
    """

    name = "conductor"

    def __init__(self, separable=False):
        self.normals = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, ROUGHNESS, sample_visible=True)
        self.separable = separable

    def reflect(self, wi, wo):
        """BRDF times cosine: F D G2 / (4 cos o); wi and wo as for `Diffuse`."""
        half = dr.normalize(wi + wo)
        fresnel = F0 + (1 - F0) * (1 - dr.dot(wi, half)) ** 5
        if self.separable:
            shadowing = self.normals.G(wi, wo, half)
        else:
            shadowing = 1 / (1 + smith_lambda(wi) + smith_lambda(wo))
        value = fresnel * self.normals.eval(half) * shadowing / (4 * wo.z)
        return dr.select((wi.z > 0) & (wo.z > 0), value, 0)

    def bounce(self, wo, random):
        """As for `Diffuse`, by Mitsuba's visible normals; a direction below the horizon has weight 0."""
        half, pdf = self.normals.sample(wo, mi.Point2f(random(dr.width(wo)), random(dr.width(wo))))
        wi = mi.reflect(wo, half)
        return wi, self.reflect(wi, wo) * 4 * dr.dot(wo, half) / pdf


def smith_lambda(w):
    """Lambda of GGX: (sqrt(1 + alpha^2 tan^2) - 1) / 2."""
    return (dr.sqrt(1 + ROUGHNESS**2 * (w.x**2 + w.y**2) / w.z**2) - 1) / 2


def mitsuba_image(tile, material, integrator, samples, light=None):
    """Mitsuba's image of the scene."""
    generator = np.random.default_rng(SEED)

    def random(count):
        return mi.Float(generator.random(count, dtype=np.float32))

    light = light_direction() if light is None else light
    sums = np.zeros((2, FILM[1] * FILM[0]))
    for _ in range(samples // PASS):
        origin, direction = camera_rays(tile, generator)
        radiance = reflected(tile, material, (origin, direction), (integrator, light), random).numpy()
        radiance = radiance.reshape(-1, PASS).astype(np.float64)
        sums += radiance.sum(1), (radiance**2).sum(1)
    mean = sums[0] / samples
    variance = (sums[1] / samples - mean**2) / (samples - 1)
    return Image(mean.reshape(FILM[::-1]), variance.reshape(FILM[::-1]))


def camera_rays(tile, generator):
    """`PASS` random rays a pixel, from where they come into the range of heights."""
    row, column = np.divmod(np.repeat(np.arange(FILM[1] * FILM[0]), PASS), FILM[0])
    place = np.stack([column, row], -1) + generator.random((row.size, 2)) - np.array(FILM) / 2
    place *= PERIOD / FILM[0]
    sine = np.sqrt(1 - COS_VIEW**2)
    direction = np.array([0, -COS_VIEW, -sine])
    points = place[:, :1] * [1, 0, 0] - place[:, 1:] * [0, sine, -COS_VIEW]
    points += (tile.range[1] - points[:, 1:2]) / direction[1] * direction
    return mi.Vector3f(tile.wrapped(points).T.astype(np.float32)), dr.repeat(mi.Vector3f(direction.tolist()), row.size)


def reflected(tile, material, rays, settings, random):
    """Light that comes back along `rays`, sample by sample: next-event estimation at every hit."""
    (origin, direction), (integrator, light) = rays, settings
    to_light = mi.Vector3f(light.tolist())
    radiance = dr.zeros(mi.Float, dr.width(direction))
    path, throughput = dr.arange(mi.UInt32, dr.width(direction)), dr.full(mi.Float, 1, dr.width(direction))
    bounce = 0
    while True:
        hit, start, normal = tile.intersect(origin, direction)
        kept = dr.compress(hit)
        if dr.width(kept) == 0:
            return radiance
        path, throughput = dr.gather(mi.UInt32, path, kept), dr.gather(mi.Float, throughput, kept)
        start, normal, direction = (dr.gather(mi.Vector3f, v, kept) for v in (start, normal, direction))
        frame = mi.Frame3f(normal)
        wo = frame.to_local(-direction)
        lit = throughput * IRRADIANCE * material.reflect(frame.to_local(to_light), wo)
        lit = dr.select(occluded(tile, start, to_light, lit > 0), 0, lit)
        dr.scatter_add(radiance, lit, path)
        if integrator == "direct":
            return radiance
        wi, weight = material.bounce(wo, random)
        throughput *= weight
        if bounce >= SURE_BOUNCES:
            survival = dr.minimum(throughput, MAX_SURVIVAL)
            throughput = dr.select(random(dr.width(path)) < survival, throughput / survival, 0)
        on = dr.compress(throughput > 0)
        if dr.width(on) == 0:
            return radiance
        path, throughput = dr.gather(mi.UInt32, path, on), dr.gather(mi.Float, throughput, on)
        origin, direction = (dr.gather(mi.Vector3f, v, on) for v in (start, frame.to_world(wi)))
        dr.eval(radiance, path, throughput, origin, direction)
        bounce += 1


def occluded(tile, start, to_light, wanted):
    """Whether the surface hides the light from `start`, where that is wanted."""
    asked = dr.compress(wanted)
    hidden = dr.zeros(mi.UInt32, dr.width(wanted))
    if dr.width(asked) == 0:
        return hidden == 1
    start = dr.gather(mi.Vector3f, start, asked)
    hit, _, _ = tile.intersect(start, dr.repeat(to_light, dr.width(asked)))
    dr.scatter(hidden, mi.UInt32(1), asked, hit)
    return hidden == 1


# --- comparison


class Image:
    """Means of the pixels, `[row][column]`, and variances of these means."""

    def __init__(self, pixels, variance):
        self.pixels, self.variance = pixels, variance

    def mean(self):
        """Mean of all pixels."""
        return self.pixels.mean()

    def error(self):
        """Standard error of that mean."""
        return np.sqrt(self.variance.sum()) / self.variance.size


def compare(base, integrator, ours, theirs):
    """Prints a line of the table; the exit code."""
    difference = ours.mean() / theirs.mean() - 1
    error = np.hypot(ours.error() / ours.mean(), theirs.error() / theirs.mean())
    spread = ours.variance + theirs.variance
    seen = spread > 0
    z = np.sqrt((((ours.pixels - theirs.pixels)[seen]) ** 2 / spread[seen]).mean())
    cells = [f"{image.mean():.5f} ± {image.error():.5f}" for image in (ours, theirs)]
    change = f"{100 * difference:+.3f} ± {100 * error:.3f} %"
    print(f"{base:<12}{integrator:<12}{cells[0]:>20}{cells[1]:>20}{change:>18}{z:>13.2f}", flush=True)
    if abs(difference) > LIMIT:
        return DIFFERS
    return CANNOT_TELL if error > RESOLUTION else AGREES


# --- what the comparison leans on


def checks(heights, samples):
    """Changes of Mitsuba's mean, direct light, by what was chosen here; the exit code."""
    print(f"\n{'base':<12}{'in place of':<32}{'taken':<26}{'change of the mean':>20}")
    # the twill repeats along v eight times: an eighth of the tile is the same plane
    strip, spacing = heights[: heights.shape[0] // 8], PERIOD / heights.shape[1]
    assert np.abs(heights - np.tile(strip, (8, 1))).max() < 2e-5 * np.ptp(heights), "the strip repeats to a code"
    tiles = {cut: Tile(strip, spacing, cut) for cut in (1, 2, 4)}
    faces = Tile(strip, spacing, 4, normals="Face")
    tile = tiles[CUT]
    codes = []
    for material in (Diffuse(), Conductor()):

        def line(before, after, old, new, bound, name=material.name):
            codes.append(change(name, before, after, old, new, bound))

        usual = mitsuba_image(tile, material, "direct", samples)
        others = tiles[1], tiles[4], faces
        coarse, fine, flat = (mitsuba_image(other, material, "direct", samples) for other in others)
        line("1 × 1 quads a cell", "2 × 2", coarse, usual, None)
        line("2 × 2 quads a cell", "4 × 4", usual, fine, RESOLUTION)
        line("normals of patches, 4 × 4", "of triangles, 4 × 4", fine, flat, RESOLUTION)
        for offset, bound in [(OFFSET / 2, RESOLUTION), (OFFSET * 4, RESOLUTION), (SPAWN_OFFSET / spacing, None)]:
            tile.offset = offset * spacing
            line(f"{OFFSET} cells off the surface", f"{offset:.3f} cells", usual,
                 mitsuba_image(tile, material, "direct", samples), bound)
        tile.offset = OFFSET * spacing
        mirrored = mitsuba_image(tile, material, "direct", samples, light=light_direction() * [-1, 1, 1])
        line("the light", "mirrored in x", usual, mirrored, None)
    separable = mitsuba_image(tile, Conductor(separable=True), "direct", samples)
    line("height-correlated shadowing", "separable, as Mitsuba's", usual, separable, None)
    return max(codes)


def change(base, before, after, old, new, bound):
    """Prints how the mean changes, by the same random numbers; whether that is within `bound`."""
    difference = (new.pixels - old.pixels).ravel() / old.mean()
    mean, error = difference.mean(), difference.std() / np.sqrt(difference.size)
    print(f"{base:<12}{before:<32}{after:<26}{f'{100 * mean:+.3f} ± {100 * error:.3f} %':>20}", flush=True)
    return CANNOT_TELL if bound is not None and abs(mean) > bound else AGREES


if __name__ == "__main__":
    sys.exit(main())
