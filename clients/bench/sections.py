"""What the document of results consists of: questions, the commands that answer them, and how to read the answers."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SECTIONS", "Section", "sized"]


@dataclass(frozen=True, slots=True)
class Section:
    """A question and the command that answers it, the arguments of `farside bench`.

    {sequences}: the folder of sequences with ground truth, {NAME}: a folder that holds the twin of that name, written
    at `scale`, `frames` frames. reports: whether it takes --report, for plots and figures.
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
        """What stands in braces in its arguments."""
        return tuple(text[1:-1] for text in self.arguments if text.startswith("{"))


_BALANCED = ("--quality", "balanced")

SECTIONS = (
    Section(
        "peers", "How near to the truth are pictures, next to other renderers?",
        ("peers", "{sequences}", *_BALANCED),
        "PSNR-Y / IV-PSNR in dB. The others know one instant only, Farside the frames before it as well. The last "
        "column is the distance to the best of them.",
    ),
    Section(
        "paper", "What do the defaults gain over the published algorithm?",
        ("paper", "--scale", "0.25", "--frames", "21", "--every", "5"),
        "`paper` is the preset of that name. Holes are fractions of pixels before filling; times are wall times of a "
        "picture, a frame's update and the first frame; drawn are triangles a picture, modelled those of the model. "
        "Memory is that of the model's images and surfaces, and of the ray tracer.",
        reports=True,
    ),
    Section(
        "accuracy", "How do all figures look, over sequences and twins?",
        ("accuracy", "--twins", "hijack,painter", "--scale", "0.15", "--frames", "16", "--every", "15", "--background"),
        "Means over cameras and frames, with the model, which knows the given views only. SSIMs are those of MPEG's "
        "tool. Bias and roughness of silhouettes are in pixels; the truth's own roughness stands next to it.",
        reports=True,
    ),
    Section(
        "model", "What is the background model worth?",
        ("model", "{museum}", "--frames", "61", "--every", "12", *_BALANCED),
        "IV-PSNR in dB, medians after the second second: five views with the model, five without, and all views "
        "without. The worst loss is that of one frame. Holes are fractions of pixels before filling.",
        reports=True,
    ),
    Section(
        "noise", "Does the model pay with noisy depth, in every frame?",
        ("noise", "painter", "--scale", "0.125", "--frames", "31", "--views", "2", *_BALANCED),
        "The first table is the model's error against the true background, the second what it is worth: dB with the "
        "model less dB without.",
    ),
    Section(
        "sparse", "What is completing sparse depth worth?",
        ("sparse", "{hijack}",),
        "PSNR-Y / IV-PSNR in dB, depth punched as time of flight leaves it.",
        scale=0.2, frames=1,
    ),
    Section(
        "exposure", "What is following the exposure of views worth?",
        ("exposure", "museum", "--scale", "0.125", *_BALANCED),
        "PSNR-Y / IV-PSNR in dB, where views have gains of up to 15 % and other white balances.",
    ),
    Section(
        "backdrop", "Which surface of the model should a picture show?",
        ("backdrop", "doorway", "--scale", "0.1", "--frames", "31", "--every", "10", *_BALANCED),
        "The paper shows the farthest surface; standing is the nearest that no camera has seen past.",
    ),
    Section(
        "minified", "What is prefiltering worth where pictures are coarser than views?",
        ("minified", "museum", "--scale", "0.25", *_BALANCED),
        "PSNR-Y / IV-PSNR / SSIM, by pixels of a view to one of the picture.",
    ),
    Section(
        "fill", "How near to the truth is what fills holes?",
        ("fill", "{painter}", *_BALANCED),
        "PSNR-Y and SSIM inside holes only.",
        scale=0.2, frames=16,
    ),
    Section(
        "flicker", "Does a picture keep still where the scene does?",
        ("flicker", "{painter}", "--views", "2", "--frames", "60", *_BALANCED),
        "Change from frame to frame in codes of luma, of pictures and of the truth, in whole pictures and in holes.",
        scale=0.2, frames=60,
    ),
    Section(
        "ghosts", "How fast do people who move on leave the model?",
        ("ghosts", "museum", "--scale", "0.125", "--frames", "60"),
        "Percent of pixels. Ghosts: the model is nearer than the true background and the present scene; standing: "
        "nearer than the background only.",
        reports=True,
    ),
    Section(
        "tolerances", "Are tolerances that follow from the scene good ones?",
        ("tolerances", *_BALANCED),
        "Each automatic tolerance from an eighth of it to eight times it; the last table compares it with the best.",
        reports=True,
    ),
    Section(
        "targets", "How fast is it at the paper's size?",
        ("targets", "museum", "--scale", "1", "--frames", "9"),
        "24 views of 2048 x 2048 pixels; what is wanted stands next to what is measured.",
    ),
    Section(
        "stages", "Where does the time go?",
        ("stages", "museum", "--scale", "0.25", *_BALANCED),
        "Medians of wall and CPU time, and the work of each stage.",
        reports=True,
    ),
    Section(
        "pairs", "How many stereo pairs a second, while the model is updated?",
        ("pairs", "museum", "--scale", "0.25", "--quality", "fast"),
        "One process; updates are asked for at different rates.",
    ),
    Section(
        "trade", "What does each knob cost, and what is it worth?",
        ("trade", "{sequences}", "--twins", "museum,painter", "--scale", "0.12"),
        "Differences and ratios to `balanced`; the fronts are what is worth choosing.",
        reports=True,
    ),
    Section(
        "scaling", "How does cost grow with pixels?",
        ("scaling", "museum", "--scale", "0.25", *_BALANCED),
        "CPU milliseconds over three doublings of a picture's pixels, and of the views' pixels.",
        reports=True,
    ),
    Section(
        "live", "How does it do live, over localhost?",
        ("live", "{museum}", "--quality", "fast", "--size", "1280x1440"),
        "Server, replay and headset are a process each. Stalls of the event loop are shown with and without the time "
        "that it waited for a core; an idle loop stands next to them.",
    ),
    Section(
        "extremes", "Where do numbers end?",
        ("extremes",),
        "The largest error against an exact oracle, by its bound.",
        reports=True,
    ),
    Section(
        "spared", "What work and memory does a scene not need?",
        ("spared", "museum,painter"),
        "All of it, and what is left of it.",
    ),
)  # fmt: skip


def sized(section: Section, scale: float | None, frames: int | None) -> Section:
    """A section at another size: pictures of `scale`, at most `frames` frames; None: as it is."""
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


# Options of size that a section leaves at their defaults.
_TAKES = {
    "tolerances": ("--scale",),
    "stages": ("--frames",),
    "trade": ("--frames",),
    "fill": ("--frames",),
    "spared": ("--scale", "--frames"),
}
