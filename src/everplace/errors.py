"""Every error everplace raises on purpose.

Each message is one sentence that names the file or option and the remedy; the command prints it and exits with
the class's status.

    EverplaceError
    ├── InputError                  bad usage or bad input, exit status 2
    │   ├── ConfigError             an option, a TOML file or a value in it
    │   │   ├── SettingError        a setting by its name, which a command knows as an option
    │   │   └── OtherRunError       a run directory holds another run than the one to continue
    │   ├── RouteError              the structure of a route: folders, stems, conditions, poses
    │   │   └── NotAlignedError     nothing says which frames of two traverses show the same place
    │   ├── ImageError              one image file that cannot be decoded
    │   ├── DescriptorsError        a descriptor file or array
    │   ├── CheckpointError         a run directory or a checkpoint
    │   ├── MapError                a map that is missing, damaged, or does not hold what is asked of it
    │   └── MethodError             a method that does not exist or cannot run here
    │       └── MissingExtraError   an optional dependency is not installed
    ├── StoppedError                Ctrl-C, where there is more to say than that, exit status 130
    └── MachineError                the machine failed, exit status 1
        ├── StorageError            disk full, no permission, quota
        ├── DownloadError           no network, or a server that does not give the file
        └── DivergedError           training met a number that is not finite
"""

from __future__ import annotations

__all__ = [
    "CheckpointError",
    "ConfigError",
    "DescriptorsError",
    "DivergedError",
    "DownloadError",
    "EverplaceError",
    "ImageError",
    "InputError",
    "MachineError",
    "MapError",
    "MethodError",
    "MissingExtraError",
    "NotAlignedError",
    "OtherRunError",
    "RouteError",
    "SettingError",
    "StoppedError",
    "StorageError",
]


class EverplaceError(Exception):
    """Base of every error that everplace raises on purpose.

    Attributes:
        exit_status: The exit status of a command that ends with this error.
    """

    exit_status: int = 1


class InputError(EverplaceError):
    """Bad usage or bad input; the message names the file or option and the remedy."""

    exit_status = 2


class ConfigError(InputError):
    """An option, a TOML file or a value in it is wrong."""


class SettingError(ConfigError):
    """A setting of a configuration does not exist, or its value is out of its range.

    Attributes:
        setting: Its name, such as `minutes` or `weights.place`.
        message: What is wrong with it.
    """

    def __init__(self, setting: str, message: str) -> None:
        super().__init__(f"{setting}: {message}")
        self.setting = setting
        self.message = message


class OtherRunError(ConfigError):
    """A run directory holds another run than the one that is to be continued.

    Attributes:
        difference: What differs, such as "epochs was 1 and is now 2".
    """

    def __init__(self, message: str, difference: str) -> None:
        super().__init__(message)
        self.difference = difference


class RouteError(InputError):
    """A route's folders, stems, conditions or poses are not what the task needs."""


class NotAlignedError(RouteError):
    """Nothing says which frames of two traverses show the same place."""


class ImageError(InputError):
    """One image file cannot be decoded."""


class DescriptorsError(InputError):
    """A descriptor file or array is malformed, or two of them do not fit together."""


class CheckpointError(InputError):
    """A run directory or checkpoint is missing, of another version, or was altered."""


class MapError(InputError):
    """A map is missing, damaged, of another format, or does not hold what is asked of it."""


class MethodError(InputError):
    """A method does not exist or cannot run here."""


class MissingExtraError(MethodError):
    """An optional dependency is not installed."""

    def __init__(self, what: str, extra: str) -> None:
        super().__init__(f"{what} needs an optional dependency: pip install 'everplace[{extra}]'")


class StoppedError(EverplaceError):
    """Ctrl-C stopped the work; the message says what stands."""

    exit_status = 130


class MachineError(EverplaceError):
    """The machine failed: the input was right, but the work could not be done."""

    exit_status = 1


class StorageError(MachineError):
    """Writing failed: disk full, no permission, or quota."""


class DownloadError(MachineError):
    """A file could not be fetched: no network, or a server that does not give it, or gives another one."""


class DivergedError(MachineError):
    """Training met a number that is not finite."""
