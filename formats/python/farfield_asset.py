"""Reads a farfield asset and evaluates it, written from formats/README.md alone (sections in brackets).

    asset = load("lod/bark")
    f = f_low(asset, asset["levels"][0], x, n_c, wi, wo)    # arrays (n, 2), (n, 3), (n, 3), (n, 3) -> (n, 3)
    e = additive(asset, asset["levels"][0], x, wi, wo)      # of the base plane: lit and shadowed as section 6 says

    volume = load_volume("lod/cloth")
    sigma_t, p = flakes(volume["levels"][0], x, w, wi)      # arrays (n, 3) -> (n,), (n, 3)

Needs numpy and zstandard. Digests are not checked: BLAKE3 is not in Python's standard library.
"""
import json
import pathlib
import re
import struct

import numpy as np
import zstandard


# vkFormat, bytes and type of a channel, channels [1.3, 8.2].
FORMATS = {
    "float": (100, 4, "<f4", 1), "half4": (97, 2, "<f2", 4), "half": (76, 2, "<f2", 1),
    "byte4": (37, 1, "<u1", 4), "byte": (9, 1, "<u1", 1), "index": (98, 4, "<u4", 1),
}


def read_ktx2(data, texel, columns, rows, slices=0):
    """Texels of a payload as (rows, columns, channels), 3D ones as (slices, …), in float64 [1.3]."""
    vk_format, channel_bytes, kind, channels = FORMATS[texel]
    if len(data) < 104 or data[:12] != bytes.fromhex("ab4b5458203230bb0d0a1a0a"):
        raise ValueError("not a KTX2 file")
    header = struct.unpack_from("<9I", data, 12)
    wanted = (vk_format, channel_bytes, columns, rows, slices, 0, 1, 1, 2)
    if header != wanted:
        raise ValueError(f"wanted the header {wanted}, found {header}")
    offset, length, plain_length = struct.unpack_from("<3Q", data, 80)
    if plain_length != columns * rows * max(slices, 1) * channels * channel_bytes or offset + length > len(data):
        raise ValueError("level data of another length")
    frame = zstandard.ZstdDecompressor(max_window_size=1 << 24).decompressobj()
    plain = frame.decompress(data[offset:offset + length])
    if len(plain) != plain_length or frame.unused_data:
        raise ValueError("frame of another length")
    texels = np.frombuffer(plain, kind).astype(np.float64)
    return texels.reshape(([slices] if slices else []) + [rows, columns, channels])


def document(folder, kind):
    """asset.json of an asset of this kind [1.1, 8.1]."""
    asset = json.loads((folder / "asset.json").read_bytes())
    if (asset["format"], asset["version"], asset["kind"]) != ("farfield", 1, kind):
        raise ValueError(f"not a farfield {kind} of version 1")
    return asset


def payload(folder, file):
    """Bytes of a payload, whose name must be plain [1]."""
    path = file["path"]
    if len(path) > 200 or not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*\.ktx2", path):
        raise ValueError(f"not a plain file name: {path!r}")
    return (folder / path).read_bytes()


def load(folder):
    """asset.json with the arrays of its payloads beside the keys of each level [1]."""
    folder = pathlib.Path(folder)
    asset = document(folder, "surface")
    for level in asset["levels"]:
        tables = {}
        pairs = [level["N"] ** 2] * 2
        for file in level["files"]:
            role = file["role"]
            sizes = {"spatial": level["M"], "angular": pairs, "additive_spatial": level["M"]}
            sizes["additive_angular"] = [level["additive"]["N"] ** 2] * 2 if "additive" in level else None
            size = sizes.get(role.rstrip("0123456789"), level["cells"])
            tables[role] = read_ktx2(payload(folder, file), "float" if role == "heights" else "half4", *size)
        cells = level["cells"][0] * level["cells"][1]
        level["heights"] = tables["heights"][:, :, 0]
        lobes = np.stack([tables[f"lobe{j}"].reshape(cells, 4) for j in range(level["lobes"])], axis=1)
        level["mean"] = octahedral(lobes[..., :2])  # (cell, lobe, 3)
        level["kappa"], level["weight"] = np.expm1(lobes[..., 2]), lobes[..., 3]
        level["color"] = tables["base_color"][..., :3].reshape(cells, 3) if "base_color" in tables else np.ones((cells, 3))
        level["T"] = [tables[f"spatial{r}"][..., :3] for r in range(level["rank"])]
        level["S"] = [tables[f"angular{r}"][..., :3] for r in range(level["rank"])]
        if "additive" in level:
            level["additive"] |= {"T": tables["additive_spatial"][..., :3], "E": tables["additive_angular"][..., :3]}
    return asset


def octahedral(pq):
    """Unit directions of octahedral coordinates [3]."""
    p, q = pq[..., 0], pq[..., 1]
    z = 1 - abs(p) - abs(q)
    x = np.where(z < 0, np.copysign(1 - abs(q), p), p)
    y = np.where(z < 0, np.copysign(1 - abs(p), q), q)
    v = np.stack([x, y, z], axis=-1)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def square_of(w):
    """Point of the direction square [2]."""
    x, y, z = w[:, 0], w[:, 1], w[:, 2]
    r = np.where(z > 0, np.sqrt((x * x + y * y) / (1 + np.maximum(z, 0))), 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        along_x, along_y = np.copysign(r, x), np.copysign(r, y)
        a = np.where(abs(x) > abs(y), along_x, along_y * 4 / np.pi * np.arctan(x / y))
        b = np.where(abs(x) > abs(y), along_x * 4 / np.pi * np.arctan(y / x), along_y)
    pole = (x == 0) & (y == 0)
    return np.where(pole, 0.5, (1 + a) / 2), np.where(pole, 0.5, (1 + b) / 2)


def taps(c, n, repeat):
    """Two (index, weight) pairs of a linear lookup [4]."""
    g = (c - np.floor(c)) * n - 0.5 if repeat else np.clip(c * n - 0.5, 0, n - 1)
    k = np.floor(g).astype(int)
    border = (lambda i: i % n) if repeat else (lambda i: np.minimum(i, n - 1))
    return [(border(k), 1 - (g - k)), (border(k + 1), g - k)]


def bilinear(columns, rows):
    """Four (row, column, weight) of a table from the taps of both axes."""
    return [(j, i, a * b) for j, b in rows for i, a in columns]


def product(asset, level, tables, n, x, wi, wo):
    """Σ T·S of pairs of tables, N = n [4]."""
    mx, my = level["M"]
    repeat = asset["boundary"] == "repeat"
    place = bilinear(taps(x[:, 0], mx, repeat), taps(x[:, 1], my, repeat))
    pair = [[(j * n + i, a) for j, i, a in bilinear(taps(s, n, False), taps(t, n, False))]
            for s, t in (square_of(wi), square_of(wo))]
    total = 0
    for T, S in tables:
        t = sum(a[:, None] * T[j, i] for j, i, a in place)
        s = sum((a * b)[:, None] * S[o, i] for o, b in pair[1] for i, a in pair[0])
        total = total + t * s
    return total


def additive(asset, level, x, wi, wo):
    """The additive term T_a·E, 1/sr, without a cosine [4.1]."""
    if "additive" not in level:
        return np.zeros((len(x), 3))
    term = level["additive"]
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    return np.where(above[:, None], product(asset, level, [(term["T"], term["E"])], term["N"], x, wi, wo), 0)


def cell_at(level, x):
    """Column and row of the cell, and the fraction of it [4]."""
    size = np.array(level["cells"])
    cell = np.minimum(np.floor(x * size).astype(int), size - 1)
    return cell, x * size - cell


def normal_at(asset, level, x):
    """n_c of the coarse heights [4]."""
    size = np.array(level["cells"])
    (i, j), (s, t) = (a.T for a in cell_at(level, x))
    i1, j1 = ((i + 1) % size[0], (j + 1) % size[1]) if asset["boundary"] == "repeat" else \
             (np.minimum(i + 1, size[0] - 1), np.minimum(j + 1, size[1] - 1))
    h = level["heights"]
    h00, h10, h01, h11 = h[j, i], h[j, i1], h[j1, i], h[j1, i1]
    spacing = np.array(asset["size"]) / size
    dx = ((h10 - h00) * (1 - t) + (h11 - h01) * t) / spacing[0]
    dv = ((h01 - h00) * (1 - s) + (h11 - h10) * s) / spacing[1]
    n = np.stack([-dx, dv, np.ones_like(dx)], axis=1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def f_c(bsdf, mean, kappa, weight, color, n_c, wi, wo):
    """BRDF of one cell a point; mean (n, lobe, 3), kappa and weight (n, lobe) [5]."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        e = np.exp(-2 * kappa)
        wide = kappa < 0.03
        r = np.where(wide, kappa / 3 - kappa**3 / 45, (1 + e) / (1 - e) - 1 / kappa)
        A = np.where(wide, 1 / 3 - kappa**2 / 45, r / kappa)
        B = np.where(wide, 1 / 3 - kappa**2 / 15, 1 / kappa**2 - 4 * e / (1 - e) ** 2)
        C = np.where(kappa < 1e-6, 0.5, kappa / (1 - e))
    W = 1 + 0.0854 / np.sqrt(1 + (0.678 * kappa) ** 2)
    dot = lambda a, b: (a * b).sum(axis=-1)

    def facing(w):
        c = dot(mean, w[:, None])
        m, s = r * c, np.sqrt(A * np.maximum(1 - c * c, 0) + B * c * c)
        z = np.minimum(abs(m / np.maximum(s, 1e-9)), 8)
        phi = 0.3989423 * np.exp(-z * z / 2)
        t = phi * (1 + 0.4126071 * z + 0.07928679 * z**2) / (
            1 + 1.6654489 * z + 1.1699745 * z**2 + 0.41832913 * z**3 + 0.07909453 * z**4)
        q = phi * (1.2533141 + 0.4407736 * z + 0.07700919 * z**2) / (
            1 + 1.9477498 * z + 1.6669497 * z**2 + 0.8114917 * z**3 + 0.2237087 * z**4 + 0.03840724 * z**5)
        averted = (q + z * phi) / (z * z + 1)
        fraction = np.where(m >= 0, 1 - averted, averted)
        excess = np.sqrt(np.maximum(q - t * t - averted**2, 0)) / np.maximum(s, 1e-9)
        m = np.maximum(m, 0)
        return c, m + W * s * t, m + s * t, fraction, excess

    (ci, pi, Ii, Fi, ei), (co, po, Io, Fo, eo) = facing(wi), facing(wo)
    K = A * (dot(wi, wo)[:, None] - ci * co) + B * ci * co
    cosines = np.maximum(Ii * Io + K * (Fi * Fo + K * ei * eo), 1e-3 * Ii * Io)
    N = np.asarray(bsdf["diffuse"]) * color / np.pi * dot(weight, cosines)[:, None]

    if bsdf["specular"]:
        alpha, H = bsdf["specular"]["alpha"], np.maximum(np.linalg.norm(wi + wo, axis=1, keepdims=True), 1e-9) / 2
        u = np.clip(1 - (ci + co) / (2 * H), 0, 2)
        total = 0
        for lam, amplitude in bsdf["specular"]["gaussians"]:
            k = np.maximum(np.sqrt(np.maximum((kappa + lam) ** 2 - 2 * lam * kappa * u, 0)), 1e-4)
            E = np.exp(np.maximum(-2 * lam * kappa * u / (k + kappa + lam), -60))
            shrink, soft = (k + 1) / ((k + 1) ** 2 + 2), 0.63662 / (k + 2.5465)
            cosine = lambda d: np.clip((d + np.sqrt(d * d + soft)) / 2, 0, 1)
            Ci, Co = (cosine((lam * H + kappa * c) * shrink) for c in (ci, co))
            Ri, Ro = (np.sqrt(alpha**2 + (1 - alpha**2) * c * c) for c in (Ci, Co))
            G = 2 * Ci * Co / np.maximum(Ci * Ro + Co * Ri, 1e-12)
            total = total + amplitude * G * E * (1 - np.exp(-2 * k)) / k
        F0, F5 = np.asarray(bsdf["specular"]["f0"]) * color, np.clip(1 - H, 0, 1) ** 5
        N = N + (F0 + (1 - F0) * F5) * dot(weight, C * total / 4)[:, None]

    Pi, Po = dot(weight, pi), dot(weight, po)
    seen = (Pi >= 1e-6) & (Po >= 1e-6) & (wi[:, 2] > 0) & (wo[:, 2] > 0) & (n_c[:, 2] > 0)
    return N * np.where(seen, 1 / np.where(seen, n_c[:, 2] * Pi * Po, 1), 0)[:, None]


def f_low(asset, level, x, n_c, wi, wo):
    """The BRDF that a level stands for, 1/sr, without a cosine [4]."""
    cell, _ = cell_at(level, x)
    index = cell[:, 1] * level["cells"][0] + cell[:, 0]
    lobes = (level[key][index] for key in ("mean", "kappa", "weight", "color"))
    scaling = product(asset, level, zip(level["T"], level["S"]), level["N"], x, wi, wo)
    return scaling * f_c(asset["bsdf"], *lobes, n_c, wi, wo)


def load_volume(folder):
    """asset.json with a level's `density` and, a lobe, `S` and `a` on the whole grid, 0 where it is empty [8]."""
    folder = pathlib.Path(folder)
    asset = document(folder, "volume")
    for level in asset["levels"]:
        nx, ny, nz = level["size"]
        over = [-(-n // 8) for n in level["size"]]
        atlas = [8 * n for n in level["atlas"]]
        kinds = {"bricks": "index", "density": "half", "shape": "byte4", "albedo": "byte4", "shear": "byte"}
        tables = {}
        for file in level["files"]:
            kind = kinds[file["role"].rstrip("0123456789")]
            tables[file["role"]] = read_ktx2(payload(folder, file), kind, *(over if kind == "index" else atlas))
        # Texel of every voxel; empty bricks read texel 0 and are blanked.
        z, y, x = np.indices((nz, ny, nx))
        brick = tables["bricks"][z // 8, y // 8, x // 8, 0].astype(int) - 1
        n, (ax, ay, _) = np.maximum(brick, 0), level["atlas"]
        at = (n // (ax * ay) * 8 + z % 8, n // ax % ay * 8 + y % 8, n % ax * 8 + x % 8)
        texels = {role: table[at] for role, table in tables.items() if role != "bricks"}
        stored = np.where(brick >= 0, texels["density"][..., 0], 0)
        level["rho"] = stored * level["density"]
        level["S"], level["a"] = [], []
        for j, (low, high) in enumerate(level["albedo"]):
            shape, albedo, shear = (texels[f"{role}{j}"] for role in ("shape", "albedo", "shear"))
            xx, yy, zz = (shape[..., c] / 255 for c in range(3))
            xy, xz, yz = ((c - 128) / 254 for c in (shape[..., 3], albedo[..., 3], shear[..., 0]))
            M = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(nz, ny, nx, 3, 3)
            S = M @ M
            S += 1e-4 * np.trace(S, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
            used = (stored > 0) & (shape[..., :3].max(axis=-1) > 0)
            level["S"].append(np.where(used[..., None, None], S, 0))
            level["a"].append(np.array(low) + (np.array(high) - np.array(low)) * albedo[..., :3] / 255)
    return asset


def flakes(level, x, w, wi):
    """Extinction at the place x for the direction w, 1/m, and the phase function from w to wi, 1/sr [8.3]."""
    size = np.array(level["size"])
    i, j, k = np.minimum(np.floor(x * size).astype(int), size - 1).T
    h = w + wi
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    area, scattered = 0, 0
    for S, a in zip(level["S"], level["a"]):
        S, a = S[k, j, i], a[k, j, i]
        used = S[:, 0, 0] > 0
        whole = np.where(used[:, None, None], S, np.eye(3))
        quadratic = np.einsum("ni,nij,nj->n", h, np.linalg.inv(whole), h)
        D = np.where(used, 1 / (np.pi * np.sqrt(np.linalg.det(whole)) * quadratic**2), 0)
        area = area + np.sqrt(np.einsum("ni,nij,nj->n", w, S, w))
        scattered = scattered + a * D[:, None]
    sigma_t = level["rho"][k, j, i] * area
    return sigma_t, np.where(area > 0, 1 / np.where(area > 0, 4 * area, 1), 0)[:, None] * scattered
