"""The data sets of the field that can be fetched, and where to ask for those that cannot.

To add one, add an entry to `DATA_SETS`. An address is written here only if those who publish the set give it; a hash
only if they publish it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from everplace.errors import ConfigError
from everplace.files import readable

__all__ = ["DATA_SETS", "DataFile", "DataSet", "HubFolder", "find_data_set"]


@dataclass(frozen=True)
class DataFile:
    """One file of a data set.

    Attributes:
        name: What it is called on disk.
        url: Where it is.
        sha256: The hash it must have; None: none is published.
        size: Its size in bytes; None: not known.
        published: Whether the source publishes the hash; else it was found at the first fetch.
    """

    name: Annotated[str, Field(pattern=r"^[^/\\]+$")]
    url: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    size: int | None = None
    published: bool = False


@dataclass(frozen=True)
class HubFolder:
    """A folder of a data set on the Hugging Face Hub, whose listing gives each file's size and hash.

    Attributes:
        repository: Owner and name.
        folder: From the repository's root.
        ending: Only files with this ending count.
        server: The Hub.
    """

    repository: str
    folder: str
    ending: str
    server: str = "https://huggingface.co"


@dataclass(frozen=True)
class DataSet:
    """A data set and how to get it.

    Attributes:
        name: What `everplace data fetch` calls it.
        summary: One line: what it shows, and how much of it there is.
        licence: What its publishers allow.
        citation: What to cite.
        kind: The kind of source as which `everplace data import` reads it.
        files: What to fetch.
        hub: A folder on the Hub whose files are fetched too.
        unavailable: Why it cannot be fetched and where to ask; empty: it can.
    """

    name: str
    summary: str
    licence: str
    citation: str
    kind: str
    files: tuple[DataFile, ...] = ()
    hub: HubFolder | None = None
    unavailable: str = ""


_NRK = "Norwegian Broadcasting Corporation (NRK), Nordlandsbanen: minute by minute, season by season, 2013"
_CHEMNITZ = "https://www.tu-chemnitz.de/etit/proaut/datasets"

DATA_SETS = (
    DataSet(
        name="nordland64",
        summary="Nordland, four seasons, 64×32 pixels, grey, one frame a second (OpenSeqSLAM)",
        licence="none came with the copy, and others of the same films claim CC BY 3.0 to CC BY-NC-SA 4.0; "
        "treat it as non-commercial",
        citation=f"{_NRK}; N. Sünderhauf, P. Neubert, P. Protzel: Are We There Yet? Challenging SeqSLAM on a 3000 km "
        "Journey Across All Four Seasons, ICRA Workshop on Long-Term Autonomy, 2013",
        files=(DataFile("64x32-grayscale-1fps.tar", f"{_CHEMNITZ}/nordland/64x32-grayscale-1fps.tar"),),
        kind="nordland",
    ),
    DataSet(
        name="nordland",
        summary="Nordland, four seasons, full frames, one a second, 48 GB in four archives (Somayeh-h/Nordland)",
        licence="CC BY-NC-SA 4.0, as its page on the Hugging Face Hub says",
        citation=f"{_NRK}; copy by S. Hussaini, https://huggingface.co/datasets/Somayeh-h/Nordland",
        files=(
            DataFile(
                "nordland_imageNames.txt",
                "https://huggingface.co/datasets/Somayeh-h/Nordland/resolve/main/dataset_imageNames/"
                "nordland_imageNames.txt",
            ),
        ),
        hub=HubFolder("Somayeh-h/Nordland", "data", ".tar.gz"),
        kind="nordland",
    ),
    DataSet(
        name="nordland-olid",
        summary="Nordland, four seasons, partition of Olid et al. without tunnels and stops, 184 GB (fansel/nordland)",
        licence="CC BY 4.0, as its page on the Hugging Face Hub says",
        citation=f"{_NRK}; D. Olid, J. M. Fácil, J. Civera: Single-View Place Recognition under Seasonal Changes, "
        "PPNIV Workshop at IROS, 2018",
        hub=HubFolder("fansel/nordland", "data", ".parquet"),
        kind="nordland",
    ),
    DataSet(
        name="nordland-videos",
        summary="Nordland, the four films, ten hours each",
        licence="as NRK's page says",
        citation=_NRK,
        unavailable="NRK gives the films out on a page of its own, from where they are to be had by hand: "
        "https://nrkbeta.no/2013/01/15/nordlandsbanen-minute-by-minute-season-by-season/ "
        "(`everplace data import nordland` reads them)",
        kind="nordland",
    ),
    DataSet(
        name="gardens-point",
        summary="Gardens Point Walking, day left, day right and night right, 200 places, 32 MB",
        licence="none came with the copy; research use only",
        citation="A. Glover: Day and Night with Lateral Pose Change Datasets, Queensland University of Technology, "
        "2014, https://wiki.qut.edu.au/pages/viewpage.action?pageId=175739622",
        files=(DataFile("GardensPoint_Walking.zip", f"{_CHEMNITZ}/GardensPoint_Walking.zip"),),
        kind="gardens_point",
    ),
    DataSet(
        name="kaist",
        summary="KAIST all-day, six drives by day, night, sunrise and sunset",
        licence="by agreement with its authors",
        citation="Y. Choi, N. Kim, S. Hwang, K. Park, J. S. Yoon, K. An, I. S. Kweon: KAIST Multi-Spectral Day/Night "
        "Data Set for Autonomous and Assisted Driving, IEEE T-ITS 19(3), 934-948, 2018",
        unavailable="its sites (http://multispectral.kaist.ac.kr) do not answer any more; ask its authors, whose "
        "addresses are in the paper, for a copy (`everplace data import kaist` reads it)",
        kind="kaist",
    ),
    DataSet(
        name="ms2",
        summary="KAIST MS2, stereo, drives by day, at night and in rain",
        licence="by agreement with its authors",
        citation="U. Shin, J. Park, I. S. Kweon: Deep Depth Estimation from Thermal Image, CVPR, 2023",
        unavailable="its authors give it out by a form: "
        "https://sites.google.com/view/multi-spectral-stereo-dataset/download (`everplace data import ms2` reads it)",
        kind="ms2",
    ),
)
"""Everything that `everplace data fetch` knows of."""


def find_data_set(name: str) -> DataSet:
    """Returns the data set of this name.

    Raises:
        ConfigError: There is none, or it cannot be fetched; the message says where to ask.
    """
    for data_set in DATA_SETS:
        if data_set.name == name:
            if data_set.unavailable:
                raise ConfigError(f"{name} cannot be fetched: {data_set.unavailable}")
            return data_set
    known = ", ".join(data_set.name for data_set in DATA_SETS)
    raise ConfigError(f"there is no data set {readable(name)!r} to fetch; choose one of {known}")
