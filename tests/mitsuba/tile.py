"""One tile of a height map as a triangle mesh of Mitsuba, and rays that are wrapped into it.

Frame: that of farfield's scenes, x = +u, z = +v, y up, metres, with the tile's corner at the origin. A ray that leaves
the tile through a side comes in again at the opposite one, moved by a period: the plane is endless, its coordinates and
with them the rounding of single precision stay those of one tile.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

# Cells that the mesh goes on beyond each side, so that a ray that changes sides never runs along the mesh's rim.
SKIRT = 2
# Cells that a ray is followed beyond a side before it changes over: a hit within rounding of the side is found once.
OVERLAP = 0.01
# The usual `Tile.offset` in cells: in a tile of 1024 cells, 17 units of single precision at its far side.
OFFSET = 0.002
# Rounding of a height and of a position of the tile, relative to the tile: some units of single precision.
ROUNDING = 1e-6


class Tile:
    """A tile of heights in metres, `[v][u]`, `spacing` metres a cell; the map repeats.

    A cell is the bilinear patch between four heights. It is cut into `cut` x `cut` quads of two triangles, whose
    corners are on the patch. `normals` are those of the `Patch` or of the triangles, `Face`.
    """

    def __init__(self, heights, spacing, cut, normals="Patch"):
        rows, columns = heights.shape
        self.size = [columns * spacing, rows * spacing]
        self.overlap = OVERLAP * spacing
        margin = ROUNDING * max(self.size)
        self.range = [float(heights.min()) - margin, float(heights.max()) + margin]
        self.scene = mi.load_dict({"type": "scene", "tile": _mesh(heights, spacing, cut, normals)})
        # metres along the triangle's normal by which a ray that leaves the surface is moved
        self.offset = OFFSET * spacing
        # all rays that were followed, and those of them that got below the surface
        self.followed = self.leaked = 0

    def wrapped(self, points):
        """Points of the plane, `[ray][xyz]` in float64, moved into the tile."""
        moved = points.copy()
        moved[:, [0, 2]] %= self.size
        return moved

    def intersect(self, origin, direction):
        """First hits of the rays, piece by piece until each meets the surface or leaves its range of heights.

        Returns whether each ray hits, and for those that do where in the tile the next ray starts, just above the
        surface, and the unit normal.
        """
        count = dr.width(direction)
        hits, start, normal = dr.zeros(mi.UInt32, count), dr.zeros(mi.Vector3f, count), dr.zeros(mi.Vector3f, count)
        ray = dr.arange(mi.UInt32, count)
        self.followed += count
        while dr.width(ray) > 0:
            reach, side = self._reach(origin, direction)
            piece = mi.Ray3f(mi.Point3f(origin), direction, reach + self.overlap, 0.0, mi.Color0f())
            si = self.scene.ray_intersect(piece)
            hit = si.is_valid()
            dr.scatter(hits, mi.UInt32(1), ray, hit)
            dr.scatter(start, mi.Vector3f(si.p + self.offset * si.n), ray, hit)
            dr.scatter(normal, mi.Vector3f(si.sh_frame.n), ray, hit)
            # triangles face up: whoever meets one from underneath, or the bottom of the box, has slipped through
            leaked = dr.select(hit, dr.dot(si.n, direction) > 0, (side == 1) & (direction.y < 0))
            end, goes_on = self._changed_over(origin + reach * direction, direction, side), ~hit & (side != 1)
            dr.eval(hits, start, normal, leaked, end, goes_on)
            self.leaked += int(dr.count(leaked)[0])
            on = dr.compress(goes_on)
            origin, direction = dr.gather(mi.Vector3f, end, on), dr.gather(mi.Vector3f, direction, on)
            ray = dr.gather(mi.UInt32, ray, on)
        return hits == 1, start, normal

    def _reach(self, origin, direction):
        """Metres until a ray leaves the box of the tile, and the axis of the side that it leaves through."""
        low, high = [0, self.range[0], 0], [self.size[0], self.range[1], self.size[1]]
        reach, side = mi.Float(dr.inf), mi.UInt32(1)
        for axis in range(3):
            start, along = origin[axis], direction[axis]
            to_side = dr.select(along > 0, high[axis] - start, low[axis] - start) / along
            # along = 0 never leaves; a start within rounding beyond its side leaves at once
            to_side = dr.select(along == 0, dr.inf, dr.maximum(to_side, 0))
            side = dr.select(to_side < reach, axis, side)
            reach = dr.minimum(reach, to_side)
        return reach, side

    def _changed_over(self, end, direction, side):
        """Where a ray that leaves through `side` at `end` comes in again."""
        for axis in (0, 2):
            period = dr.select(direction[axis] > 0, -self.size[axis // 2], self.size[axis // 2])
            end[axis] = dr.select(side == axis, end[axis] + period, end[axis])
        return end


def _mesh(heights, spacing, cut, normals):
    """The mesh of the tile and its skirt; every cell has vertices of its own, as its normals are."""
    h = np.pad(heights, ((SKIRT, SKIRT + 1), (SKIRT, SKIRT + 1)), mode="wrap")
    cells = np.array(h.shape) - 1
    corners = [part.reshape(-1, 1) for part in (h[:-1, :-1], h[:-1, 1:], h[1:, :-1], h[1:, 1:])]
    t, s = (part.ravel() for part in np.meshgrid(*2 * [np.arange(cut + 1) / cut], indexing="ij"))
    v, u = (part.reshape(-1, 1) - SKIRT for part in np.meshgrid(*map(np.arange, cells), indexing="ij"))
    y, slope_x, slope_z = _patch(corners, s, t)
    positions = _interleaved((u + s) * spacing, y, (v + t) * spacing)

    corner = np.arange((cut + 1) ** 2).reshape(cut + 1, cut + 1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]  # b along x, c along z
    faces = np.stack([a, c, b, b, c, d], axis=-1).ravel()
    faces = (np.arange(cells.prod()) * corner.size).reshape(-1, 1) + faces

    properties = mi.Properties()
    properties["face_normals"] = normals == "Face"
    mesh = mi.Mesh("tile", y.size, faces.size // 3, props=properties, has_vertex_normals=normals == "Patch")
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(positions)
    parameters["faces"] = mi.UInt32(faces.ravel().astype(np.uint32))
    parameters.update()
    if normals == "Patch":
        # Slopes of a patch are linear over it: normals of length 1/cos are interpolated without error. They are set
        # after the positions, which replace them.
        parameters["vertex_normals"] = mi.Float(_interleaved(-slope_x / spacing, np.ones_like(y), -slope_z / spacing))
        parameters.update()
    return mesh


def _patch(corners, s, t):
    """Heights of bilinear cells at the fractions `s` along x and `t` along z, and the slopes per cell."""
    h00, h10, h01, h11 = corners
    along_x, along_z = (h10 - h00) * (1 - t) + (h11 - h01) * t, (h01 - h00) * (1 - s) + (h11 - h10) * s
    return h00 * (1 - t) + h01 * t + along_x * s, along_x, along_z


def _interleaved(x, y, z):
    """Vectors in single precision, one after the other."""
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1).astype(np.float32).ravel()
