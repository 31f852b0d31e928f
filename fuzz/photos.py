"""Fuzz the reading of photographs: image files and their EXIF, corrupted in every way.

Requirement: `read_photo` returns a photograph or raises a one-line DataError that names the file; the focal length from
its tags is positive and finite, or absent with a reason.

The first byte of an input selects what the rest is: a whole file, or an EXIF block embedded in a valid JPEG, PNG, WebP
or TIFF, so that the fuzzer does not have to rediscover those containers for each corrupt tag.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import os
import random
import struct
import sys
import tempfile
import time
import warnings
import zlib
from functools import lru_cache
from pathlib import Path
from typing import Any

_WIDTH, _HEIGHT = 12, 9
_MAX_BYTES = 4096


def gradient(mode: str) -> Any:
    from PIL import Image

    return Image.linear_gradient("L").resize((_WIDTH, _HEIGHT)).convert(mode)


@lru_cache
def plain(mode: str, kind: str) -> bytes:
    return saved(gradient(mode), kind)


def saved(image: Any, kind: str, **options: Any) -> bytes:
    out = io.BytesIO()
    image.save(out, kind, **options)
    return out.getvalue()


def exif_block() -> bytes:
    """TIFF structure with the tags that are read, including valid and invalid rationals."""
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112], exif[0x010F] = 6, "Maker"
    inner = exif.get_ifd(0x8769)
    inner[0x920A], inner[0xA405], inner[0xA404] = 4.25, 26, 2.0
    inner[0xA002], inner[0xA003], inner[0xA20E], inner[0xA210] = 4000, 3000, 800.0, 3
    return exif.tobytes()[6:]


def unsound_block(order: str = "<") -> bytes:
    """Hand-made: a zero denominator, an offset beyond the end, a directory that points to itself."""
    head = struct.pack(order + "2sHI", b"II" if order == "<" else b"MM", 42, 8)
    rows = [
        struct.pack(order + "HHII", 0x0112, 3, 1, 9),
        struct.pack(order + "HHII", 0x8769, 4, 1, 8),
        struct.pack(order + "HHII", 0x920A, 5, 1, 0xFFFF),
        struct.pack(order + "HHII", 0xA405, 4, 1, 0xFFFFFFFF),
        struct.pack(order + "HHII", 0xA20E, 10, 1, 62),
    ]
    return head + struct.pack(order + "H", len(rows)) + b"".join(rows) + struct.pack(order + "III", 0, 1, 0)


def jpeg_with(block: bytes) -> bytes:
    sound, payload = plain("RGB", "JPEG"), b"Exif\0\0" + block[:60_000]
    return sound[:2] + b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload + sound[2:]


def png_with(block: bytes) -> bytes:
    sound = plain("L", "PNG")
    body = b"eXIf" + block
    chunk = struct.pack(">I", len(block)) + body + struct.pack(">I", zlib.crc32(body))
    return sound[:33] + chunk + sound[33:]  # after the signature and IHDR


def webp_with(block: bytes) -> bytes:
    sound = plain("RGB", "WEBP")
    size = struct.pack("<I", _WIDTH - 1)[:3] + struct.pack("<I", _HEIGHT - 1)[:3]
    chunks = b"VP8X" + struct.pack("<IB3x", 10, 8) + size + sound[12:]
    chunks += b"EXIF" + struct.pack("<I", len(block)) + block + b"\0" * (len(block) % 2)
    return b"RIFF" + struct.pack("<I", len(chunks) + 4) + b"WEBP" + chunks


CONTAINERS = (lambda data: data, jpeg_with, png_with, webp_with)


def seeds() -> list[bytes]:
    """Inputs to start from, a few hundred bytes each."""
    from PIL import Image

    files = [saved(gradient(mode), "PNG") for mode in ("1", "L", "P", "LA", "RGB", "RGBA", "I;16")]
    files += [saved(gradient(mode), "TIFF") for mode in ("1", "L", "RGB", "CMYK", "I;16", "F", "I")]
    files += [saved(gradient("RGB"), "TIFF", compression=c) for c in ("tiff_lzw", "tiff_deflate", "packbits", "jpeg")]
    files += [saved(gradient(mode), "JPEG") for mode in ("L", "RGB", "CMYK")]
    Image.init()
    others = ("BMP", "GIF", "PPM", "WEBP", "JPEG2000", "AVIF", "MPO")
    files += [saved(gradient("RGB"), kind) for kind in others if kind in Image.SAVE]
    blocks = [exif_block(), unsound_block("<"), unsound_block(">"), b"", b"II*\0", b"MM\0*\0\0\0\x08"]
    found = [b"\0" + data for data in files]
    found += [bytes([container]) + block for container in range(1, len(CONTAINERS)) for block in blocks]
    # Complete valid files with a valid block: the fuzzer may corrupt their checksums and lengths.
    return found + [b"\0" + make(blocks[0]) for make in CONTAINERS[1:]]


class Target:
    """One photograph at a time, read from a file as for users."""

    def __init__(self) -> None:
        from roundel.scenes.errors import DataError
        from roundel.solver.intrinsics import exif
        from roundel.solver.photos import photo_file

        self.DataError, self.exif, self.photo_file = DataError, exif, photo_file
        # Files that declare a hundred megapixels are covered by `tests`: here they would only take time.
        photo_file.MAX_PIXELS = 1_000_000
        self.path = Path(tempfile.mkdtemp(prefix="roundel-fuzz-")) / "photo.jpg"

    def __call__(self, data: bytes) -> None:
        if not data:
            return
        self.path.write_bytes(CONTAINERS[data[0] % len(CONTAINERS)](data[1:]))
        try:
            photo = self.photo_file.read_photo(self.path)
        except self.DataError as error:
            if "\n" in str(error) or not str(error).startswith(str(self.path)):
                raise AssertionError(f"not one line that names the file: {error!r}") from error
            return
        height, width = photo.grey.shape
        assert photo.picture.shape == (height, width, 3), photo.picture.shape
        assert photo.grey.min() >= 0, photo.grey.min()
        assert photo.grey.max() <= photo.saturation_dn * (1 + 1e-6), photo.grey.max()
        focal = self.exif.focal_of_exif(photo.exif, width, height)
        assert focal or focal.reason
        if focal:
            assert 0 < focal.focal_px < 1e9, focal
            assert 0 < focal.sigma < 1, focal


def mutated(data: bytes, generator: random.Random) -> bytes:
    """Mutations like libFuzzer's, without coverage: bits, bytes, numbers, removed or inserted pieces, truncation."""
    out = bytearray(data)
    for _ in range(generator.choice((1, 1, 2, 4, 16))):
        at = generator.randrange(1, len(out)) if len(out) > 1 else 0
        match generator.randrange(6):
            case 0:
                out[at] ^= 1 << generator.randrange(8)
            case 1:
                out[at] = generator.choice((0, 1, 0x7F, 0x80, 0xFF, generator.randrange(256)))
            case 2:
                number = generator.choice((0, 1, 8, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, generator.randrange(2**32)))
                out[at : at + 4] = struct.pack(generator.choice("<>") + "I", number)
            case 3:
                del out[at : at + generator.randrange(1, 32)]
            case 4:
                out[at:at] = out[at : at + generator.randrange(1, 32)]
            case 5:
                del out[at:]
        if not out:
            out = bytearray(b"\0")
    return bytes(out[:_MAX_BYTES])


def blind(seconds: float, first_seed: int) -> int:
    """Mutations of the seeds without feedback, where atheris is not installed."""
    target, generator, start, count = Target(), random.Random(first_seed), seeds(), 0
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        data = mutated(generator.choice(start), generator)
        try:
            target(data)
        except Exception:
            print(f"photos: failure: {data!r}", file=sys.stderr)
            raise
        count += 1
    return count


def guided(corpus: Path, arguments: list[str]) -> None:
    """Run atheris, which exits the process itself."""
    import atheris

    with atheris.instrument_imports(include=["PIL", "roundel"]):
        import PIL.ExifTags
        import PIL.Image
        import PIL.JpegImagePlugin
        import PIL.PngImagePlugin
        import PIL.TiffImagePlugin
        import PIL.WebPImagePlugin  # noqa: F401

        target = Target()
    corpus.mkdir(parents=True, exist_ok=True)
    for data in seeds():
        (corpus / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)
    options = ["-timeout=20", "-rss_limit_mb=3000", f"-max_len={_MAX_BYTES}", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], *options, *arguments, str(corpus)], target)
    atheris.Fuzz()


def main() -> int:
    parser = argparse.ArgumentParser(description="Fuzz the reading of photographs.")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--blind", action="store_true", help="mutate at random, without atheris")
    parser.add_argument("--corpus", type=Path, default=Path("out/fuzz/photos"), help="inputs that reach new code")
    parser.add_argument("files", nargs="*", type=Path, help="inputs to run once, such as a failing one")
    asked = parser.parse_args()
    warnings.simplefilter("error")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if asked.files:
        target = Target()
        for path in asked.files:
            target(path.read_bytes())
        return 0
    if asked.blind:
        print(f"photos: {blind(asked.seconds, asked.seed)} files, no failure")
        return 0
    finds = f"-artifact_prefix={asked.corpus.parent}/find-"
    guided(asked.corpus, [f"-max_total_time={int(asked.seconds)}", f"-seed={asked.seed + 1}", finds])
    return 0


if __name__ == "__main__":
    sys.exit(main())
