"""What an object store's client says when a request fails, in one line."""

from __future__ import annotations

import re

from roundel.scenes.errors import DataError, RoundelError

# Hosts that clouds ask for credentials: asked when the environment has none.
_METADATA = ("169.254.169.254", "169.254.170.2", "metadata.google.internal")
_STATUS = re.compile(r"status code: (\d{3}) ?([A-Za-z ]*)")
_CODE = re.compile(r"<Code>(\w+)</Code>")
_SYSTEM = re.compile(r"kind: (\w+)")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")


def is_taken(error: BaseException | None) -> bool:
    """Whether a request failed because the object is there already."""
    return type(error).__name__ in ("AlreadyExistsError", "FileExistsError")


def is_final(error: Exception) -> bool:
    """Whether the same request would fail the same way again."""
    status = _STATUS.search(str(error))
    refused = status is not None and status[1].startswith("4") and status[1] not in ("400", "408", "409", "425", "429")
    missing = any(host in str(error) for host in _METADATA)
    settled = is_taken(error) or type(error).__name__ in (
        "NotSupportedError",
        "NotImplementedError",
        "UnknownConfigurationKeyError",
    )
    return isinstance(error, RoundelError) or refused or missing or settled


def failure(place: str, error: Exception) -> RoundelError:
    """One-line error for a request that failed."""
    if isinstance(error, RoundelError):
        return error
    text, kind = str(error), type(error).__name__
    if any(host in text for host in _METADATA):
        return DataError(
            f"{place}: no credentials were found; set those of the store (AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, "
            "GOOGLE_APPLICATION_CREDENTIALS, AZURE_STORAGE_ACCOUNT_KEY)"
        )
    code, status = _CODE.search(text), _STATUS.search(text)
    if code is not None and code[1] in ("NoSuchBucket", "ContainerNotFound"):
        return DataError(f"{place}: there is no such bucket")
    if kind in ("PermissionDeniedError", "UnauthenticatedError"):
        answer = f" ({code[1]})" if code else ""
        return DataError(f"{place}: the store refuses access{answer}; check the credentials and what they may do")
    if is_taken(error):
        return DataError(f"{place}: somebody else has written it")
    if kind in ("NotSupportedError", "NotImplementedError"):
        return DataError(f"{place}: this server can only be read")
    return DataError(
        f"{place}: the store does not answer as it should ({_said(text, code, status)}); what is finished is kept: run "
        "the command again"
    )


def _said(text: str, code: re.Match[str] | None, status: re.Match[str] | None) -> str:
    if status is not None:
        what = f"{status[1]} {status[2].strip()}".strip()
        return f"{what}, {code[1]}" if code else what
    systems = _SYSTEM.findall(text)
    if systems:
        return _CAMEL.sub(" ", systems[-1]).lower()
    if "timed out" in text or "TimedOut" in text:
        return "it timed out"
    # Without the addresses, which are long, and the time it took.
    return text.split("\n", 1)[0].rpartition(" - ")[2][:120]
