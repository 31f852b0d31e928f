"""Labels of intrinsics, such as `true` or `scaled:0.7`: parsing, order and display text.

Records store the label as text; only this module parses it.
"""

from __future__ import annotations

from dataclasses import dataclass

# Display order: the most accurate first.
KINDS = ("true", "calibrated", "exif", "default", "scaled")


@dataclass(frozen=True)
class IntrinsicsLabel:
    """A parsed label: `kind`, and the value after the colon.

    Examples
    --------
    >>> IntrinsicsLabel.of("calibrated:5").views, IntrinsicsLabel.of("scaled:0.7").factor
    (5, 0.7)
    """

    kind: str
    value: str

    @classmethod
    def of(cls, label: str) -> IntrinsicsLabel:
        """Parse the label of a record; any text is valid."""
        kind, _, value = label.partition(":")
        return cls(kind, value)

    @property
    def text(self) -> str:
        """The label as stored in records."""
        return f"{self.kind}:{self.value}" if self.value else self.kind

    @property
    def views(self) -> int | None:
        """Number of views of a calibration of the form `calibrated:5`; None for any other label."""
        counted = self.kind == "calibrated" and self.value.isascii() and self.value.isdecimal()
        return int(self.value) if counted else None

    @property
    def views_of_set(self) -> int | None:
        """`views`, or of one of several sets of views as in `calibrated:5_2`; None for any other label."""
        first, mark, number = self.value.partition("_")
        numbered = self.kind == "calibrated" and mark and number.isascii() and number.isdecimal()
        return IntrinsicsLabel(self.kind, first).views if numbered else self.views

    @property
    def factor(self) -> float:
        """Factor on the true focal length of `scaled:X`; 0 for any other label."""
        return self.number if self.kind == "scaled" else 0.0

    @property
    def number(self) -> float:
        """The number after the colon; 0 if there is none."""
        return float(self.value) if self.value.replace(".", "", 1).isdigit() else 0.0

    @property
    def is_right(self) -> bool:
        """Whether the label stands for the camera's own focal length."""
        return self.kind in ("true", "calibrated") or self.factor == 1.0

    @property
    def rank(self) -> tuple[int, float, str]:
        """Sort key: the most accurate first; among calibrations, the one from most views."""
        number = -self.number if self.kind == "calibrated" else self.number
        return KINDS.index(self.kind) if self.kind in KINDS else len(KINDS), number, self.text

    @property
    def short(self) -> str:
        """For a legend or a clause, as in the paper's figures: `x0.7`."""
        return f"x{self.value}" if self.kind == "scaled" else self.text

    @property
    def title(self) -> str:
        """For a table or a legend with room: `calibrated, 5 views`, `focal x 0.7`."""
        if self.kind == "calibrated":
            return "calibrated" if self.views is None else f"calibrated, {self.views} views"
        return {"exif": "EXIF", "scaled": f"focal x {self.value}"}.get(self.kind, self.text)

    @property
    def phrase(self) -> str:
        """For a sentence: `a focal length of 0.7 times the true one`."""
        if self.kind == "scaled":
            return (
                "the camera's own focal length"
                if self.is_right
                else f"a focal length of {self.value} times the true one"
            )
        words = self.value.split(":")
        by_width = " (taken by width)" if "width" in words else ""
        decade = " of the 2020s" if "2020s" in words else ""
        return {
            "true": "the camera's own intrinsics",
            "calibrated": "intrinsics calibrated from a chessboard",
            "exif": "the focal length of the file's EXIF",
            "default": f"the default focal length of a phone{decade}{by_width}",
        }.get(self.kind, self.text)
