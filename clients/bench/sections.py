"""The sections of the document of results: questions, the commands that answer them, and how to read the answers."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SECTIONS", "Section", "sized"]


@dataclass(frozen=True, slots=True)
class Section:
    """A question, and the arguments of the `farside bench` command that answers it.

    In the arguments {sequences} stands for the folder of sequences with ground truth, and {NAME} for a folder that
    holds the twin of that name, written at `scale` with `frames` frames. reading: how to read the answer. reports:
    whether the command takes --report, for plots and figures.
    """

    key: str
    question: str
    arguments: tuple[str, ...]
    reading: str
    reports: bool = False
    scale: float = 0.25
    frames: int = 61

    @property
    def needs(self) -> tuple[str, ...]:
        """The names in braces among the arguments."""
        return tuple(text[1:-1] for text in self.arguments if text.startswith("{"))


_BALANCED = ("--quality", "balanced")

SECTIONS = (
    Section(
        "peers", "How close to the truth are pictures, compared with other renderers?",
        ("peers", "{sequences}", *_BALANCED),
        "PSNR-Y / IV-PSNR in dB. The other renderers get one frame only; Farside has seen the frames before it, too. "
        "The last column is Farside's IV-PSNR minus that of the best other renderer.",
    ),
    Section(
        "paper", "What do the defaults gain over the published algorithm?",
        ("paper", "--scale", "0.25", "--frames", "21", "--every", "5"),
        "`paper` is the preset of that name. Holes are fractions of pixels before filling. Times are wall times of a "
        "picture, of a frame's update and of the first frame. Drawn: triangles drawn for a picture; modelled: "
        "triangles of the model. Memory includes the model's images and surfaces, and the ray tracer. Then the paper's "
        "experiments, in all qualities. Table 2: a stereo pair's time, holes before filling, and dB against the truth "
        "without and with filling, for cameras outside the rig. Section 4.2: what a moving camera adds. Table 3: the "
        "gain in speed next to the published one. Pictures: all views, five views, five with the model, truth.",
        reports=True,
    ),
    Section(
        "accuracy", "What do all quality figures say, over sequences and twins?",
        ("accuracy", "--twins", "hijack,painter", "--scale", "0.15", "--frames", "16", "--every", "15", "--background"),
        "Means over cameras and frames, with the model, which is built from the given views only. SSIMs are those of "
        "MPEG's tool. Bias and roughness of silhouettes are in pixels, next to the roughness of the truth itself.",
        reports=True,
    ),
    Section(
        "model", "How much does the background model gain?",
        ("model", "{museum}", "--frames", "61", "--every", "12", *_BALANCED),
        "IV-PSNR in dB, medians from the third second on: five views with the model, five views without it, and all "
        "views without it. The worst loss by the model is that of a single frame. Holes are fractions of pixels before "
        "filling.",
        reports=True,
    ),
    Section(
        "noise", "Does the model help with noisy depth, in every frame?",
        ("noise", "painter", "--scale", "0.125", "--frames", "31", "--views", "2", *_BALANCED),
        "The first table is the model's error against the true background, the second its gain: dB with the model "
        "minus dB without it.",
    ),
    Section(
        "sparse", "How much does completing sparse depth gain?",
        ("sparse", "{hijack}",),
        "PSNR-Y / IV-PSNR in dB, from depth with the holes that a time-of-flight sensor would leave.",
        scale=0.2, frames=1,
    ),
    Section(
        "exposure", "How much does following the exposure of views gain?",
        ("exposure", "museum", "--scale", "0.125", *_BALANCED),
        "PSNR-Y / IV-PSNR in dB. The views have different gains of up to 15 % and different white balances.",
    ),
    Section(
        "light", "How much does the background model gain from following the light?",
        ("light", "museum-lamps", "--scale", "0.125", "--frames", "210", *_BALANCED),
        "PSNR in dB, without and with following, before, while and after the lamps change. Filled: pixels whose "
        "surface no view sees now. Model: the model itself next to the empty room, and its part that people hide. "
        "Flicker: change of filled pixels in codes of luma from one judged frame to the next where the truth keeps "
        "still. Last, CPU time of the model's update with following, as a multiple of that without.",
    ),
    Section(
        "backdrop", "Which surface of the model should a picture show?",
        ("backdrop", "doorway", "--scale", "0.1", "--frames", "31", "--every", "10", *_BALANCED),
        "Farthest: the farthest surface, as in the paper; standing: the nearest surface that no camera has seen past.",
    ),
    Section(
        "moving", "What does a reference camera that moves add to the model?",
        ("moving", "gymnasium-a,gymnasium-b", "--scale", "0.5", "--views", "2", *_BALANCED),
        "Each cell holds two figures, without the moving camera and with it. It only updates the model; pictures are "
        "drawn from two of the four fixed views. Holes are before filling. Since the row before, asked: its pixels "
        "that its capture before did not show; added: triangles of those that are farther than the model; culled: all "
        "triangles that were culled. P-PBS: what has accumulated (Fig. 12b of the paper). Below: whether updates get "
        "slower, and the triangles that there would be without culling.",
        reports=True,
    ),
    Section(
        "minified", "How much does prefiltering gain where pictures are coarser than views?",
        ("minified", "museum", "--scale", "0.25", *_BALANCED),
        "PSNR-Y / IV-PSNR / SSIM, by the width in view pixels that one pixel of the picture covers.",
    ),
    Section(
        "fill", "How close to the truth are filled holes?",
        ("fill", "{painter}", *_BALANCED),
        "PSNR-Y and SSIM inside holes only.",
        scale=0.2, frames=16,
    ),
    Section(
        "flicker", "Does a picture keep still where the scene does?",
        ("flicker", "{painter}", "--views", "2", "--frames", "60", *_BALANCED),
        "Change from frame to frame in codes of luma, of rendered pictures and of the truth: in whole pictures and in "
        "holes.",
        scale=0.2, frames=60,
    ),
    Section(
        "ghosts", "How fast do people who move on disappear from the model?",
        ("ghosts", "museum", "--scale", "0.125", "--frames", "60"),
        "Percent of pixels. Ghosts: the model is nearer than both the true background and the present scene; standing: "
        "it is nearer than the background only.",
        reports=True,
    ),
    Section(
        "layers", "What does the model gain beyond the paper's limits?",
        ("layers", "lounge", "--scale", "0.125", "--frames", "61", *_BALANCED),
        "Only pixels that no drawn view shows count. Wrong: the backdrop is off by more than delta; unknown: there is "
        "none. Ghosts: the model is nearer than both what always stands and the present scene. Ratio: of the "
        "updates' CPU time. Stale: what a view shows to have gone is culled at once; "
        "layers: also, what no camera has seen past stays, as furniture in the middle of a room.",
    ),
    Section(
        "tolerances", "Are the tolerances that follow from the scene good?",
        ("tolerances", *_BALANCED),
        "Each automatic tolerance is varied from one eighth to eight times its value; the last table compares it with "
        "the best value.",
        reports=True,
    ),
    Section(
        "targets", "How fast is it at the paper's size?",
        ("targets", "museum", "--scale", "1", "--frames", "9"),
        "24 views of 2048 x 2048 pixels; each measured figure is followed by its target.",
    ),
    Section(
        "stages", "Where does the time go?",
        ("stages", "museum", "--scale", "0.25", *_BALANCED),
        "Medians of wall and CPU time of each stage, and its amount of work.",
        reports=True,
    ),
    Section(
        "pairs", "How many stereo pairs a second are rendered while the model is updated?",
        ("pairs", "museum", "--scale", "0.25", "--quality", "fast"),
        "One process; updates are requested at different rates.",
    ),
    Section(
        "trade", "What does each setting cost, and what does it gain?",
        ("trade", "{sequences}", "--twins", "museum,painter", "--scale", "0.12"),
        "Differences and ratios to `balanced`; the fronts are the choices that no other choice beats in both cost and "
        "quality.",
        reports=True,
    ),
    Section(
        "scaling", "How does cost grow with pixels?",
        ("scaling", "museum", "--scale", "0.25", *_BALANCED),
        "CPU milliseconds over three doublings of a picture's pixels, and of the views' pixels.",
        reports=True,
    ),
    Section(
        "queries", "How many questions about the model are answered in a second?",
        ("queries", "museum", "--scale", "0.25", *_BALANCED),
        "Rays start anywhere among the cameras and go in all directions. The best of five runs; CPU time is of all "
        "threads. By HTTP a request is packed beforehand, and its answer is not unpacked; no video plays meanwhile.",
    ),
    Section(
        "saving", "How long do pictures and updates wait while the model is saved?",
        ("saving", "museum", "--scale", "0.25", *_BALANCED),
        "The engine is a process of its own; the model is saved every three seconds instead of every minute. A copy is "
        "made between two updates, and written by a thread of its own.",
    ),
    Section(
        "live", "How fast and steady is the live service, over localhost?",
        ("live", "{museum}", "--quality", "fast", "--size", "1280x1440"),
        "Server, replay and headset are a process each. Stalls of the event loop are shown with and without the time "
        "for which it waited for a core; those of an idle loop are next to them.",
    ),
    Section(
        "startup", "How long does it take from nothing to the demo's first picture?",
        ("startup", "--runs", "3"),
        "From the start of `farside demo` to the first picture in a real browser: with an empty cache, once more when "
        "everything has been made, and where only the kernels are there, as in a container or a wheel of `.ci/wheel`.",
    ),
    Section(
        "compile", "How much work is compiling?",
        ("compile",),
        "CPU seconds of each kernel by itself. Several uses share most kernels. `picture` is all that the first "
        "pictures need, before there is a background model.",
        reports=True,
    ),
    Section(
        "extremes", "How exact are results when numbers are at their extremes?",
        ("extremes",),
        "The largest error against an exact oracle, next to its bound.",
        reports=True,
    ),
    Section(
        "spared", "What work and memory does a scene not need?",
        ("spared", "museum,painter"),
        "All of the work or memory that a scene could take, and the part that is left.",
    ),
)  # fmt: skip


def sized(section: Section, scale: float | None, frames: int | None) -> Section:
    """A section at another size: twins' pictures at `scale`, at most `frames` frames; None leaves the section's own."""
    values = list(section.arguments)
    for option, value in (("--scale", scale), ("--frames", frames)):
        if value is not None and option in values:
            values[values.index(option) + 1] = f"{value:g}"
        elif value is not None and option in _TAKES.get(section.key, ()):
            values += [option, f"{value:g}"]
    return Section(
        section.key, section.question, tuple(values), section.reading, section.reports,
        section.scale if scale is None else scale, min(section.frames, frames or section.frames),
    )  # fmt: skip


# By section, the options of size that its command has although the section leaves them at their defaults.
_TAKES = {
    "tolerances": ("--scale",),
    "stages": ("--frames",),
    "trade": ("--frames",),
    "fill": ("--frames",),
    "spared": ("--scale", "--frames"),
    "moving": ("--frames",),
    "queries": ("--frames",),
    "saving": ("--frames",),
}
