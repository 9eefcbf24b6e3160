"""`everplace localize`."""

from __future__ import annotations

import contextlib
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from everplace.cli.output import require_file, show_progress, warn
from everplace.errors import ConfigError, StoppedError
from everplace.files import readable

if TYPE_CHECKING:
    from everplace.mapping.frame_stream import SeenFrame
    from everplace.mapping.localizer import Localizer
    from everplace.mapping.map_answer import Observation

    Sink = Callable[[int, SeenFrame, Observation, bool], None]
    """Takes a frame's number and the frame, what was answered, and whether that is sure enough."""

__all__ = ["localize"]


def localize(
    map_: Annotated[str, typer.Argument(metavar="MAP", help="The map.")],
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="Images, a video, a bag, /dev/video0, or an rtsp:// address.")
    ],
    *,
    json_lines: Annotated[bool, typer.Option("--json-lines", help="One JSON object a frame on stdout.")] = False,
    sequence: Annotated[
        str, typer.Option("--sequence", metavar="L|off", help="Answer from the last L frames, or from each alone.")
    ] = "10",
    precision: Annotated[
        float | None,
        typer.Option("--precision", metavar="P", help="Only matches so sure that a share P of them is right."),
    ] = None,
    exclude: Annotated[
        int | None,
        typer.Option(
            "--exclude",
            min=1,
            metavar="N",
            help="Frames nearer than N in one and the same drive of the map do not match.",
        ),
    ] = None,
    name: Annotated[
        str,
        typer.Option("--name", metavar="NAME", help="The drive of the map that SOURCE is [its file or directory]."),
    ] = "",
    file_format: Annotated[
        Literal["csv", "tum", "g2o", "hloc-pairs"], typer.Option("--format", help="Of --out.")
    ] = "csv",
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="File to write.")] = None,
    rerun: Annotated[
        Path | None,
        typer.Option("--rerun", metavar="FILE.rrd", help="Recording for the Rerun viewer (extra `rerun`)."),
    ] = None,
) -> None:
    """Say of every frame where on a map it was taken, how sure that is, and under which condition.

    Example: everplace localize my-map winter.mp4 --json-lines
    """
    length = _length(sequence)
    _require_sense(precision, out, rerun)
    from everplace.files import STANDARD_OUTPUT
    from everplace.mapping.answer_formats import FORMATS, answer_file
    from everplace.mapping.frame_stream import open_stream
    from everplace.mapping.localizer import Localizer
    from everplace.mapping.rerun_recording import require_rerun, rerun_recording

    if rerun is not None:
        require_rerun()
    stream = open_stream(source)
    progress = show_progress()
    localizer = Localizer(map_, sequence=length, progress=progress)
    excluded = None if exclude is None else (_drive_of(name or stream.name, localizer), exclude)
    least = localizer.threshold(precision)
    frames = progress(stream.frames, f"localizing {stream.name}", stream.count)
    with contextlib.ExitStack() as outputs:
        sinks: list[Sink] = []
        if json_lines:
            sinks.append(_printing(marked=precision is not None))
        if out is not None or not json_lines:
            written = outputs.enter_context(answer_file(out or STANDARD_OUTPUT, FORMATS[file_format]))
            sinks.append(
                lambda number, frame, seen, sure: written.add(number, frame.stem, seen.answer) if sure else None
            )
        if rerun is not None:
            recording = outputs.enter_context(rerun_recording(rerun, localizer))
            sinks.append(lambda _, frame, seen, __: recording.add(frame, seen))
        counted, stopped = _answer(localizer, frames, excluded, least, sinks)
    if localizer.provisional:
        warn(
            "the map knows one drive only, so its probabilities are provisional; add another drive with "
            "`everplace map add`"
        )
    said = f"{counted.total()} frames localised"
    if precision is not None:
        said += f", {counted[True]} of them with a probability of {least:.3f} or more"
    if stopped:
        files = " and ".join(readable(path) for path in (out, rerun) if path is not None)
        raise StoppedError(f"stopped; {said}" + (f"; they are in {files}" if files else ""))
    print(f"everplace: {said}", file=sys.stderr)


def _answer(
    localizer: Localizer,
    frames: Iterator[SeenFrame],
    excluded: tuple[str, int] | None,
    least: float,
    sinks: Sequence[Sink],
) -> tuple[Counter[bool], bool]:
    """Answers frame by frame until there is none, or Ctrl-C: a camera never ends.

    Args:
        localizer: Answers.
        frames: In order.
        excluded: A drive of the map, and how far its frames must be from one of the same number to match.
        least: The probability from which a match is sure.
        sinks: Take every answer.

    Returns:
        How many answers were sure and were not, and whether Ctrl-C stopped it.

    Raises:
        KeyboardInterrupt: Ctrl-C, before anything was answered.
    """
    counted: Counter[bool] = Counter()
    try:
        for number, frame in enumerate(frames):
            left_out = None if excluded is None else (excluded[0], number, excluded[1])
            seen = localizer.observe(frame.image, frame.seconds, excluded=left_out)
            sure = seen.answer.probability >= least
            for sink in sinks:
                sink(number, frame, seen, sure)
            counted[sure] += 1
    except KeyboardInterrupt:
        if not counted:
            raise
        return counted, True
    return counted, False


def _printing(*, marked: bool) -> Sink:
    """Prints an answer as a line of JSON; `marked`: with whether it is sure."""

    def show(_: int, frame: SeenFrame, seen: Observation, sure: bool) -> None:
        line = {"frame": frame.stem, **seen.answer.to_dict()}
        if marked:
            line["accepted"] = sure
        print(json.dumps(line), flush=True)

    return show


def _drive_of(name: str, localizer: Localizer) -> str:
    """The drive of the map that the source is."""
    if name not in localizer.map.drives:
        raise ConfigError(
            f"--exclude leaves out frames of a drive of the map, but the map holds no drive {readable(name)!r}; give "
            f"one of {', '.join(map(readable, localizer.map.drives))} by --name"
        )
    return name


def _require_sense(precision: float | None, out: Path | None, rerun: Path | None) -> None:
    if precision is not None and not 0 < precision < 1:
        raise ConfigError(f"--precision {precision} is no share between 0 and 1, such as 0.99")
    if out is not None:
        require_file(out)
    if rerun is not None:
        require_file(rerun, (".rrd",), "--rerun")


def _length(sequence: str) -> int:
    if sequence == "off":
        return 1
    if not (sequence.isascii() and sequence.isdecimal() and int(sequence) >= 1):
        raise ConfigError(f"--sequence {sequence!r} is neither off nor a number of frames of at least 1")
    return int(sequence)
