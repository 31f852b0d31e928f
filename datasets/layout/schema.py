"""The records of a dataset as strict schemas: what is read from disk has every key, in range, and no other."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from roundel.datasets.layout.developed import Repeated
from roundel.datasets.layout.files import IMAGES, MASKS, RADIANCE
from roundel.datasets.store.store import MOST_BYTES, is_confined
from roundel.scenes.errors import DataError

Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Count = Annotated[int, Field(ge=0, lt=1 << 53)]
_Pixels = Annotated[int, Field(ge=1, le=1 << 16)]
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Row = Annotated[list[_Number], Field(min_length=3, max_length=3)]
# Older than 0.1: their extra keys are read over.
_LOOSE = ConfigDict(strict=True, extra="ignore", frozen=True)
_STRICT = ConfigDict(strict=True, extra="forbid", frozen=True)

Model = TypeVar("Model", bound=BaseModel)


class FileRecord(BaseModel):
    """Size and checksum of a file."""

    model_config = _STRICT
    bytes: Annotated[int, Field(ge=0, le=MOST_BYTES)]
    sha256: Digest


def _confined(names: Any) -> None:
    for name in names:
        if not is_confined(name):
            raise ValueError(f"{name[:80]!r} is not the name of a file of this dataset")


class FidelityRecord(BaseModel):
    """What was measured of a circle, see `fidelity.measure.compare`; or the reason why nothing was."""

    model_config = _STRICT
    reason: str | None = None
    effect: str = ""
    shift_x_px: _Number | None = None
    shift_y_px: _Number | None = None
    scale_px: _Number | None = None
    shift_se_px: _Number | None = None
    residual: _Number | None = None
    monte_carlo: _Number | None = None
    z_rms: _Number | None = None
    z_passed: bool | None = None
    pixels: Count | None = None
    chi2_left: _Number | None = None
    z_pixels: Count | None = None
    z_worst: _Number | None = None
    z_limit: _Number | None = None
    z_rms_limit: _Number | None = None

    @model_validator(mode="after")
    def _whole(self) -> FidelityRecord:
        names = ("shift_x_px", "shift_y_px", "scale_px", "shift_se_px", "residual", "monte_carlo", "z_rms", "z_passed")
        missing = [name for name in names if getattr(self, name) is None]
        if self.reason is None and self.model_fields_set and missing:
            raise ValueError(f"{missing[0]}: is missing")
        return self


class EntryRecord(BaseModel):
    """A line of the journal: a finished frame."""

    model_config = _STRICT
    frame_id: Count
    group: str
    files: dict[str, FileRecord]
    fidelity: dict[str, FidelityRecord]
    photometry: dict[str, dict[str, _Number | None]]
    numbers_sha256: Digest | None = None
    backend: str = "llvm"
    environment: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")] | None = None
    exposure_e: _Number | None = None
    saturated_fraction: _Number | None = None
    sensor: dict[str, Any] | None = None
    flags: list[str] = []

    @model_validator(mode="after")
    def _own_files(self) -> EntryRecord:
        stem = f"{self.frame_id:06d}"
        own = {f"{IMAGES}/{stem}.png", f"{IMAGES}/{stem}.jpg", f"{RADIANCE}/{stem}.exr", f"{MASKS}/{stem}.exr"}
        other = sorted(set(self.files) - own)
        if other:
            raise ValueError(f"files: {other[0][:80]!r} is no file of frame {self.frame_id}")
        return self


class EnvironmentRecord(BaseModel):
    """What made a frame, see `datasets.environment`."""

    model_config = _STRICT
    environment: dict[str, Any]
    versions: dict[str, str]


class HeaderRecord(BaseModel):
    """The first record of a log: who writes."""

    model_config = _STRICT
    log: Literal[1]
    dataset_id: Digest
    environment: EnvironmentRecord
    mix: bool


class LogRecord(BaseModel):
    """A further record of a log: a frame that is claimed, or one that is finished."""

    model_config = _STRICT
    claim: Count | None = None
    entry: EntryRecord | None = None
    seconds: dict[str, _Number] = {}


class SensorRecord(BaseModel):
    """The sensor of a frame: what undoes its processing."""

    model_config = _STRICT
    bits: Annotated[int, Field(ge=1, le=16)]
    stored_shift: Annotated[int, Field(ge=0, le=15)]
    saturation_dn: Annotated[float, Field(gt=0, le=65_535)]
    curve: Literal["linear", "srgb", "gamma"]
    gamma: Annotated[float, Field(gt=0, le=100)] | None = None
    adc_bits: Annotated[int, Field(ge=1, le=32)] | None = None
    gain_dn_per_e: _Number | None = None
    black_level_dn: _Number | None = None
    full_well_e: _Number | None = None
    read_noise_e: _Number | None = None
    dark_e: _Number | None = None
    prnu: _Number | None = None
    dsnu_e: _Number | None = None
    shot_noise: bool | None = None
    mosaic: str | None = None
    deliver: str | None = None
    isp: dict[str, _Number] | None = None
    white_balance: _Row | None = None

    @model_validator(mode="after")
    def _whole(self) -> SensorRecord:
        if self.curve == "gamma" and self.gamma is None:
            raise ValueError("gamma: is missing")
        if self.bits + self.stored_shift > 16:
            raise ValueError("stored_shift: more than 16 bits in all")
        return self


class _Exif(BaseModel):
    model_config = _STRICT
    focal_35mm_mm: _Positive | None = None


class _TwistPrior(BaseModel):
    model_config = _STRICT
    velocity_sigma_m_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    rate_sigma_deg_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]


class MarkerRecord(BaseModel):
    """A printed marker."""

    model_config = _STRICT
    marker_id: Count
    kind: str
    diameter_m: _Positive | None
    layout: dict[str, Any] = {}
    size_m: Annotated[list[_Positive], Field(min_length=2, max_length=2)] | None = None


class CameraRecord(BaseModel):
    """A frame in cameras.json."""

    model_config = _STRICT
    frame_id: Count
    group: str
    mode: Literal["images", "points"]
    image: str | None = None
    sensor: SensorRecord | None = None
    width_px: _Pixels
    height_px: _Pixels
    K: Annotated[list[_Row], Field(min_length=3, max_length=3)]
    distortion_model: Literal["none", "opencv", "fisheye"] = "opencv"
    distortion: Annotated[list[_Number], Field(max_length=14)] = []
    exif: _Exif | None = None
    lateral_ca: Annotated[list[_Positive], Field(min_length=2, max_length=2)] | None = None
    exposure_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    readout_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    twist_prior: _TwistPrior | None = None
    markers: list[MarkerRecord]

    @model_validator(mode="after")
    def _own_image(self) -> CameraRecord:
        stem = f"{IMAGES}/{self.frame_id:06d}"
        if self.mode == "images" and self.image not in (f"{stem}.png", f"{stem}.jpg"):
            raise ValueError(f"image: {str(self.image)[:80]!r} is no image of frame {self.frame_id}")
        return self


class CamerasRecord(BaseModel):
    """cameras.json."""

    model_config = _STRICT
    schema_: Literal[1] = Field(default=1, alias="schema")
    frames: list[CameraRecord]


class CountsRecord(BaseModel):
    """Numbers of what a dataset, or a shard of it, holds."""

    model_config = _STRICT
    frames: Count
    images: Count = 0
    markers: Count = 0
    groups: dict[str, Count] = {}
    flags: dict[str, Count] = {}


class PartRecord(BaseModel):
    """A shard, in the manifest of a dataset that has several."""

    model_config = _STRICT
    folder: str
    frames: Annotated[list[Count], Field(min_length=2, max_length=2)]
    bytes: Annotated[int, Field(ge=0, le=MOST_BYTES)]
    sha256: Digest
    images_sha256: Digest


class _Extent(BaseModel):
    model_config = _STRICT
    mean: _Number
    ci95: _Number
    worst: _Number


class _Measured(BaseModel):
    """Fidelity over circles, see `fidelity.summary.summarise`."""

    model_config = _STRICT
    circles: Annotated[int, Field(ge=1)]
    shift_x_px: _Extent
    shift_y_px: _Extent
    scale_px: _Extent
    shift_bound_px: _Number
    residual: _Number
    monte_carlo: _Number
    z_rms: _Number
    z_passed: Count
    z_consistent: bool
    by_effect: dict[str, _Measured] = {}
    unmeasured: dict[str, Count] = {}


class _Unmeasured(BaseModel):
    model_config = _STRICT
    circles: Literal[0] = 0
    reason: str = ""
    unmeasured: dict[str, Count] = {}


def _fidelity(summary: dict[str, Any]) -> dict[str, Any]:
    """The summary of the fidelity as it is, if it has every key in range."""
    try:
        (_Measured if summary.get("circles") else _Unmeasured).model_validate(summary)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{where}: {first['msg']}") from None
    return summary


FidelitySummary = Annotated[dict[str, Any], AfterValidator(_fidelity)]


class RadianceRecord(BaseModel):
    """The rendered frames whose radiance a developed dataset has, see `datasets.layout.developed`."""

    model_config = _STRICT
    dataset_id: Digest
    groups: dict[str, Repeated] = {}


class ShardRecord(BaseModel):
    """shard.json: what a shard holds."""

    model_config = _STRICT
    schema_: Literal[2] = Field(alias="schema")
    dataset_id: Digest
    first_frame: Count
    complete: bool
    counts: CountsRecord
    environments: dict[str, EnvironmentRecord]
    fidelity: FidelitySummary
    files: dict[str, FileRecord]
    images_sha256: Digest
    developed_from: Digest | None = None
    radiance_of: RadianceRecord | None = None

    @model_validator(mode="after")
    def _names(self) -> ShardRecord:
        _confined(self.files)
        return self


class _ReferenceSigma(BaseModel):
    model_config = _STRICT
    normal_deg: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    position_m: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    position_pct: Annotated[float, Field(ge=0, allow_inf_nan=False)]


class ReferenceRecord(BaseModel):
    """Where the poses of imported photographs come from: they are measured, and no truth.

    `sigma` has their standard deviations, RMS over the circles; `photographs` the original name of each frame, and
    `left_out` why others have none.
    """

    model_config = _STRICT
    kind: Literal["board"]
    board: Literal["chessboard", "charuco"]
    camera: Literal["photographs", "file"]
    sigma: _ReferenceSigma
    photographs: Annotated[list[str], Field(min_length=1)]
    left_out: dict[str, str] = {}


class ManifestRecord(BaseModel):
    """manifest.json."""

    model_config = _STRICT
    schema_: Literal[1, 2] = Field(alias="schema")
    tool: str = "roundel"
    name: str = ""
    licence: str = ""
    study: dict[str, Any]
    study_sha256: Digest | None = None
    dataset_id: Digest
    sampling_version: Count | None = None
    seed: int = 0
    groups: list[str] | None = None
    versions: dict[str, str] = {}
    environment: dict[str, Any] = {}
    environments: dict[str, EnvironmentRecord] | None = None
    counts: CountsRecord
    fidelity: FidelitySummary = {}
    files: dict[str, FileRecord]
    complete: bool = True
    images_sha256: Digest | None = None
    developed_from: Digest | None = None
    radiance_of: RadianceRecord | None = None
    truth_salted_sha256: Digest | None = None
    shards: list[PartRecord] | None = None
    reference: ReferenceRecord | None = None

    @model_validator(mode="after")
    def _names(self) -> ManifestRecord:
        _confined(self.files)
        _confined(part.folder for part in self.shards or ())
        return self


class OldManifestRecord(ManifestRecord):
    """manifest.json of version 1, of which some measured the fidelity otherwise."""

    model_config = _LOOSE
    fidelity: dict[str, Any] = {}


def checked(model: type[Model], record: Any, place: str) -> Model:
    """A record as its schema.

    Raises
    ------
    DataError
        If it does not fit; the message is one line with the key.
    """
    try:
        return model.model_validate(record)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        what = {"missing": "is missing", "extra_forbidden": "is not known; is it of a newer Roundel?"}.get(
            first["type"], first["msg"].removeprefix("Value error, ")
        )
        raise DataError(f"{place}: damaged: {key[:120]}{': ' if key else ''}{what}") from error
