"""Every knob of the engine in one frozen object, and the presets."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

__all__ = ["ANTIALIASES", "BACKDROPS", "FILLS", "MODELLING", "PER_PICTURE", "PRESETS", "QUALITIES", "Settings"]

FILLS = ("none", "smooth", "structure")
QUALITIES = ("fast", "balanced", "best")
PRESETS = (*QUALITIES, "paper")
ANTIALIASES = ("none", "morphological", "samples")
BACKDROPS = ("farthest", "standing")
# Settings that only the rendering and encoding of a picture read: they may change from picture to picture
# (`Engine.retune`). The settings of the model and of the meshes stay as long as the engine lives.
PER_PICTURE = (
    "n_render", "fill", "settles", "overdraw", "ghost_test", "rims", "output_scale", "blend", "antialias", "cubic",
    "prefilter", "jpeg_quality",
)  # fmt: skip
# Settings that the background model is built with: a saved model continues only with the same ones.
MODELLING = (
    "tolerance_px", "edge_px", "model_rims", "baseline_m", "viewing_space", "max_block_px", "delta_m",
    "delta_disparity", "margin_m", "culling_stride", "rays_by_triangle", "cull_stale", "middle_layers", "late_rounds",
    "filter_neighbours", "refine", "backdrop", "light_s",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Settings:
    """How to render and how to model the background. The paper's names are in brackets.

    Lengths are in metres, or in pixels where a name ends in _px. A tolerance of None is derived from the scene.
    """

    n_render: int = 5  # views warped per picture (n_rv^render)
    n_init: int = 6  # views that build the S-PBS (n_rv^init)
    n_update: int = 1  # views that update the P-PBS per frame (n_rv^update)
    update_interval: int = 1  # the model is updated once in this number of video frames; pictures show every frame
    background: bool = True  # keep and render the background model
    # Draw the views of reference cameras that move, too. If False, they only update the model (section 4.2), unless all
    # cameras move.
    draw_moving: bool = True
    fill: str = "structure"  # remaining holes: grey (none), blurred (smooth), their rims continued inwards (structure)
    settles: bool = True  # the filling of a hole stays the same while the head is still
    tolerance_px: float = 0.25  # error bound of triangulation, reprojected pixels; 0: two triangles per pixel
    edge_px: float | None = None  # disparity step between neighbours that is a depth edge, reprojected pixels
    completion: bool = True  # give depth to pixels without depth: 30 ms of one core per megapixel, if there are any
    overdraw: bool = True  # lay the backdrop over everything, not only where the views left holes
    # The backdrop is not shown where one of the present views sees past it. A hole shows the surface that a present
    # view sees there, even if that view is not drawn. If False, only depth decides.
    ghost_test: bool = True
    rims: bool = True  # pixels at depth edges keep their full square where no view has a surface
    model_rims: bool = True  # the same for pixels of the model; False: triangles across edges are only culled
    baseline_m: float | None = None  # how far viewers are from the cameras; None: the rig's radius
    # Heads stay in this ball: x, y, z and radius, metres in the world. Background that faces away from the whole ball,
    # or that other background hides from it, is not kept. None: heads go anywhere.
    viewing_space: tuple[float, float, float, float] | None = None
    max_block_px: int = 32  # largest leg of a triangle in the source picture; a power of two up to 32
    delta_m: float | None = None  # culling tolerance (delta), the same at all depths; the paper's is 0.2
    # Depth is far less certain far away than near by. This is delta as an error of disparity, 1/m; it counts where it
    # allows more than delta_m. None: derived from depth codes and noise, or 0 where delta_m is set.
    delta_disparity: float | None = None
    margin_m: float | None = None  # least depth increase that updates a pixel of a maximum depth image
    backdrop_m: float | None = None  # how far the backdrop is moved backwards; None: by delta at its depth
    culling_stride: int = 0  # pixels between culling rays; 1: two rays per pixel (section 3.3.2); 0: rays by triangle
    # Triangles that the rays through pixels missed get rays of their own before they are culled. If False (then
    # culling_stride must be 1 or more), they are culled at once, and only cameras that build the S-PBS cast its rays.
    rays_by_triangle: bool = True
    # Triangles also go as soon as a view sees past the whole of them, or has lost them where it has no depth, even if
    # nothing farther is ever modelled there.
    # With depth up to 5 m only, the models of two rooms have a tenth to a quarter less triangles and 40 % less ghosts,
    # for up to 8 % more time of updates; pictures hardly change (bench layers NAME --reach 5). Where all depth is
    # known, nothing is gained.
    cull_stale: bool = False
    # Up to this number of triangles that foreground culling would remove stay while no camera has seen past them:
    # furniture in the middle of a room. Needs cull_stale; no effect where the backdrop is the farthest surface. In
    # pixels that no drawn view shows, twins of such rooms (lounge, doorway) gain 0.6 to 1.1 dB PSNR-Y and 0.8 to 2 dB
    # IV-PSNR; others (museum, hijack) lose 0.1 to 2 dB, as backdrops have holes round what stands there. Updates take
    # 5 to 13 % longer (bench layers).
    middle_layers: int = 0
    # With middle_layers, what is put into the room while the video plays joins the model as well, within the same
    # number of triangles, when a camera has shown it at the same place for this number of rounds of turns, and for
    # five frames; 0: it does not. With 1, holes that show an armchair at its new place have it in 93 % of their pixels
    # instead of 81 %, and all holes gain 0.6 dB PSNR-Y and 1 dB IV-PSNR; updates take 2 ms longer at 512 x 384 while it
    # stands there, and cameras note 0.75 bytes a pixel (bench layers lounge). With 2 and 3 less is gained, as it comes
    # later; nobody who walks is in the model with 1.
    late_rounds: int = 1
    # A pixel that passes the triangle filter joins the P-PBS only if at least this number of its eight neighbours
    # belong to the P-PBS or join it too; 0: it also joins alone.
    filter_neighbours: int = 3
    # Where depth is noisy, maximum depth images average a surface that is seen again; they also replace colours that
    # were seen at an outline. If False, a pixel changes only when something farther is seen.
    refine: bool = True
    backdrop: str = "standing"  # surface of the model shown in a pixel: the nearest that stands, or the "farthest"
    pbi_scale: float = 1.0  # PBI pixels for each pixel of an eye
    pbi_margin_rad: float = math.radians(3.0)  # how far the PBI reaches beyond the eyes' frusta, for heads that turn
    # Ratio of the size of pictures to the requested size, in each direction. Pictures are rendered and sent at the
    # scaled size with the requested field of view. The display enlarges them, as headsets and browsers do in any case.
    output_scale: float = 1.0
    # Differences between the views' exposures and white balances are removed; this is the time constant, in seconds,
    # with which they are followed. 0: they are not removed. A twin with differences of 15 % gains 1 to 6 dB PSNR-Y
    # (bench --exposure museum), equal views lose nothing. It costs the back end a few milliseconds per frame,
    # whatever the size of the pictures.
    exposure_s: float = 0.5
    # Colours of the background model follow the present views when the light changes, differently from place to place;
    # this is the time constant, in seconds. 0: they stay as they were first seen. In twins whose lamps change, the
    # model gains 3 to 4 dB PSNR (bench light museum-lamps). Pictures hardly gain, as holes take the colours of other
    # present views first: the 0.1 % of pixels that only the model shows gain up to 0.6 dB. An update takes 1 to 3 %
    # more CPU time, and 5 to 20 % more while the light changes. Surfaces of an earlier model (`seeding`), and what
    # cameras saw from where they are no more, keep their colours.
    light_s: float = 0.0
    blend: int = 3  # how many of the rendered views may contribute to a pixel's colour
    # Anti-aliasing of silhouettes. morphological: blended according to the shape of their staircases (3 ns per pixel);
    # samples: drawn and shaded from four samples per pixel (this adds more than half of a picture's time). Either
    # gains 0.3 dB PSNR-Y and up to 0.3 dB IV-PSNR in pictures with many outlines (Atrium t1), and may lose as much
    # IV-PSNR elsewhere, as that metric forgives staircases.
    antialias: str = "none"
    cubic: bool = False  # cubic instead of bilinear interpolation where colours are rough; a fifth more shading time
    # Colours of a view that has 1.74 or more pixels for each of the picture's are averaged first, surface by surface.
    # With a ratio of 2, two twins gain 2.5 to 4 dB PSNR-Y (fast: 1.6) and one none, but 0.02 SSIM; with 4, all gain
    # 1.5 to 6 dB (bench --minified). This costs 2 to 3 ms of one core per megapixel of a view, and nothing for views
    # with a lower ratio.
    prefilter: bool = True
    jpeg_quality: int = 90

    def __post_init__(self) -> None:
        for name in ("n_render", "n_init", "n_update", "update_interval", "blend"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected at least 1")
        if self.fill not in FILLS:
            raise ValueError(f"fill: {self.fill!r}: expected one of {', '.join(FILLS)}")
        if self.culling_stride < 0:
            raise ValueError(f"culling_stride: {self.culling_stride!r}: expected at least 0")
        if not (self.rays_by_triangle or self.culling_stride):
            raise ValueError("rays_by_triangle: False: expected True where culling_stride is 0, as nothing casts rays")
        if self.middle_layers < 0:
            raise ValueError(f"middle_layers: {self.middle_layers!r}: expected at least 0")
        if self.middle_layers and not self.cull_stale:
            raise ValueError(f"middle_layers: {self.middle_layers!r}: expected 0 where cull_stale is False")
        if not 0 <= self.late_rounds <= 100:
            raise ValueError(f"late_rounds: {self.late_rounds!r}: expected 0 to 100")
        if not 0 <= self.filter_neighbours <= 8:
            raise ValueError(f"filter_neighbours: {self.filter_neighbours!r}: expected 0 to 8")
        for name in ("tolerance_px", "exposure_s", "light_s", "pbi_margin_rad"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected a number of at least 0")
        for name in ("pbi_scale", "output_scale"):
            if not 0.05 <= getattr(self, name) <= 4.0:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected 0.05 to 4")
        for name in ("edge_px", "delta_m", "delta_disparity", "margin_m", "backdrop_m"):
            if getattr(self, name) is not None and not getattr(self, name) >= 0:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected at least 0")
        space = self.viewing_space
        if space is not None and not (len(space) == 4 and all(map(math.isfinite, space)) and space[3] >= 0):
            raise ValueError(f"viewing_space: {space!r}: expected x, y, z and a radius, metres")
        if self.backdrop not in BACKDROPS:
            raise ValueError(f"backdrop: {self.backdrop!r}: expected one of {', '.join(BACKDROPS)}")
        if self.antialias not in ANTIALIASES:
            raise ValueError(f"antialias: {self.antialias!r}: expected one of {', '.join(ANTIALIASES)}")
        block = self.max_block_px
        if not 1 <= block <= 32 or block & (block - 1):
            raise ValueError(f"max_block_px: {block!r}: expected a power of two up to 32")

    @classmethod
    def preset(cls, quality: str = "balanced", **changes: object) -> Settings:
        """The settings of a quality (fast, balanced, best) or of the paper (`Settings.paper`), with `changes` applied.
        A number of `middle_layers` brings `cull_stale` with it, unless that is given.

        Raises ValueError for an unknown quality, a change out of range, and `late_rounds` without `middle_layers`;
        TypeError for an unknown setting.
        """
        presets = {
            "paper": cls.paper(),
            "fast": cls(tolerance_px=0.5, overdraw=False, rims=False, blend=1, pbi_scale=0.33, jpeg_quality=80),
            "balanced": cls(pbi_scale=0.5, cubic=True, antialias="morphological"),
            "best": cls(tolerance_px=0.1, blend=5, cubic=True, antialias="samples"),
        }
        if quality not in presets:
            raise ValueError(f"quality: {quality!r}: expected one of {', '.join(PRESETS)}")
        if "late_rounds" in changes and not changes.get("middle_layers"):
            raise ValueError(f"late_rounds: {changes['late_rounds']!r}: expected with middle_layers above 0")
        brought = {"cull_stale": True} if changes.get("middle_layers") else {}
        return replace(presets[quality], **(brought | changes))  # type: ignore[arg-type]

    @classmethod
    def paper(cls) -> Settings:
        """The published algorithm with its constants, without our additions.

        n_render, n_init, n_update: 5, 6 and 1 (section 4.1). draw_moving: "views from the moving camera were used only
        for the P-PBS update" (4.2). delta_m: "the threshold delta, used in the foreground culling process, was set to
        0.2" (4.1), at all depths. The paper names no other length, so margin_m ("only if the new depth is farther by a
        nontrivial amount", 3.3.3) is delta too. backdrop_m: None, delta ("moved slightly backward",
        3.4.2). tolerance_px, max_block_px: "each pixel is responsible for two triangles" (Fig. 4).
        rims, model_rims: "invalid, long and thin, back-projected triangles along the borders of objects are culled"
        (Fig. 4), and nothing takes their place. The paper does not say which depth step is an edge (edge_px).
        culling_stride: "casting two rays through each pixel of their view planes"; rays_by_triangle: "all triangles
        except the valid ones are culled", and those rays are cast for the "participating reference cameras" (3.3.2);
        complementary rays follow every hit within delta (Fig. 6a). filter_neighbours: a candidate is added "when it is
        more than distance delta behind" (Fig. 6b). refine: each pixel "stores the color and depth to the farthest
        surface observed" (3.3.3). backdrop: "finding the farthest hits seen from the imaginary camera"; pbi_margin_rad:
        "slightly larger" than the frusta (3.4.1); pbi_scale: 1, as the paper names no other size. overdraw: views "are
        3D warped onto these background images" (3.4.2); ghost_test: by depth alone. fill: "blended from the colors of
        neighboring pixels in nonhole areas, with those having farther depths more weighted" (3.4.3); settles: each
        picture is filled anew. blend: the nearest of the warped triangles gives the colour. completion, exposure_s,
        light_s, antialias, cubic and prefilter are not in the paper.

        These steps differ: n_render views are chosen by the overlap of fields of view (3.1 allows it, 4.1 took the
        nearest cameras); the filter of Fig. 6b casts its rays through the pixels of a camera, the corners of new
        triangles, not through their centres; a camera's marks stay while other cameras have their turns (3.3.3 does not
        say), and those of a camera that moves until a view sees past the triangle, as the rays of its later pictures
        miss most triangles of the earlier ones; the backdrop hides a drawn surface only where it is 3 % nearer; and the
        PBI is interpolated where it shows one plane, and has no rays where the selected views already cover the
        picture.
        """
        return cls(
            n_render=5, n_init=6, n_update=1, draw_moving=False, delta_m=0.2, delta_disparity=0.0, margin_m=0.2,
            tolerance_px=0.0, max_block_px=1, rims=False, model_rims=False, culling_stride=1, rays_by_triangle=False,
            cull_stale=False, middle_layers=0, filter_neighbours=0, refine=False, backdrop="farthest", overdraw=True,
            ghost_test=False, pbi_scale=1.0, fill="smooth", settles=False, blend=1, completion=False, exposure_s=0.0,
            light_s=0.0, antialias="none", cubic=False, prefilter=False,
        )  # fmt: skip

    @property
    def beyond(self) -> bool:
        """Whether the background model goes past the paper's limits: light that changes, stale foreground, middle and
        late layers."""
        return self.background and (self.light_s > 0.0 or self.cull_stale)

    def fixed_as_in(self, other: Settings) -> None:
        """Raises ValueError if a setting differs that may not change from picture to picture (not in `PER_PICTURE`)."""
        for field in fields(self):
            mine, theirs = getattr(self, field.name), getattr(other, field.name)
            if field.name not in PER_PICTURE and mine != theirs:
                raise ValueError(f"{field.name}: {mine!r}: expected {theirs!r}, which stays while the engine runs")
