"""`everplace localize`."""

from __future__ import annotations

import contextlib
import json
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from everplace.cli.output import require_file, show_progress, warn
from everplace.errors import ConfigError

if TYPE_CHECKING:
    from everplace.mapping.answer_formats import LocatedFrame

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
    if precision is not None and not 0 < precision < 1:
        raise ConfigError(f"--precision {precision} is no share between 0 and 1, such as 0.99")
    if out is not None:
        require_file(out)
    if rerun is not None:
        require_file(rerun, (".rrd",), "--rerun")
    from everplace.files import readable
    from everplace.mapping.answer_formats import LocatedFrame
    from everplace.mapping.frame_stream import open_stream
    from everplace.mapping.localizer import Localizer
    from everplace.mapping.rerun_recording import require_rerun, rerun_recording

    if rerun is not None:
        require_rerun()
    stream = open_stream(source)
    progress = show_progress()
    localizer = Localizer(map_, sequence=length, progress=progress)
    name = name or stream.name
    if exclude is not None and name not in localizer.map.drives:
        raise ConfigError(
            f"--exclude leaves out frames of a drive of the map, but the map holds no drive {readable(name)!r}; give "
            f"one of {', '.join(map(readable, localizer.map.drives))} by --name"
        )
    least = localizer.threshold(precision)
    kept: list[LocatedFrame] = []
    places: Counter[bool] = Counter()
    frames = progress(stream.frames, f"localizing {stream.name}", stream.count)
    with contextlib.nullcontext() if rerun is None else rerun_recording(rerun, localizer) as recording:
        for number, frame in enumerate(frames):
            seen = localizer.observe(
                frame.image, frame.seconds, excluded=None if exclude is None else (name, number, exclude)
            )
            answer = seen.answer
            sure = answer.probability >= least
            places[sure] += 1
            if recording is not None:
                recording.add(frame, seen)
            if json_lines:
                line = {"frame": frame.stem, **answer.to_dict()}
                if precision is not None:
                    line["accepted"] = sure
                print(json.dumps(line), flush=True)
            if sure and (out is not None or not json_lines):  # a camera never ends
                kept.append(LocatedFrame(frame.stem, answer))
    if localizer.provisional:
        warn(
            "the map knows one drive only, so its probabilities are provisional; add another drive with "
            "`everplace map add`"
        )
    _write(kept, file_format, out, to_stdout=not json_lines)
    said = "" if precision is None else f", {places[True]} of them with a probability of {least:.3f} or more"
    print(f"everplace: {places.total()} frames localised{said}", file=sys.stderr)


def _write(kept: list[LocatedFrame], file_format: str, out: Path | None, *, to_stdout: bool) -> None:
    from everplace.files import write_text
    from everplace.mapping import answer_formats

    if out is None and not to_stdout:
        return
    text = getattr(answer_formats, f"{file_format.replace('-', '_')}_text")(kept)
    if out is None:
        print(text, end="")
    else:
        write_text(out, text)


def _length(sequence: str) -> int:
    if sequence == "off":
        return 1
    if not (sequence.isascii() and sequence.isdecimal() and int(sequence) >= 1):
        raise ConfigError(f"--sequence {sequence!r} is neither off nor a number of frames of at least 1")
    return int(sequence)
