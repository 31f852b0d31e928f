#!/bin/sh
# Build the container of packaging/Containerfile from dist/ (make dist) and run its demo into a folder.
#
#   packaging/container.sh [--debootstrap] OUT
#
# The builder is podman, docker or buildah, whichever there is. --debootstrap: make the base image from Debian's packages
# (root, buildah and debootstrap) instead of fetching it, where no registry of images is reached. PIP_CERT, the file of
# certificates that pip trusts on this machine, is also used by pip during the build.
set -eu
cd "$(dirname "$0")/.."
made=
if [ "${1:-}" = --debootstrap ]; then made=yes; shift; fi
[ $# -eq 1 ] || { echo "usage: packaging/container.sh [--debootstrap] OUT" >&2; exit 2; }
mkdir -p "$1"
out=$(cd "$1" && pwd)
[ -n "$(ls dist/roundel-*-py3-none-any.whl 2>/dev/null)" ] || { echo "error: no wheel in dist/: make dist" >&2; exit 2; }

if [ -z "$made" ] && podman version >/dev/null 2>&1; then builder=podman
elif [ -z "$made" ] && docker version >/dev/null 2>&1; then builder=docker # answers only with its daemon
elif buildah version >/dev/null 2>&1; then builder=buildah
else echo "error: none of podman, docker and buildah works here" >&2; exit 3
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
set -- --file packaging/Containerfile --tag roundel
if [ -n "$made" ]; then
    image=localhost/debian:trixie-minbase
    if ! buildah inspect --type image "$image" >/dev/null 2>&1; then
        debootstrap --variant=minbase trixie "$folder/root"
        base=$(buildah from scratch)
        buildah add --quiet "$base" "$folder/root" /
        buildah commit --quiet --rm "$base" "$image"
    fi
    set -- "$@" --build-arg "BASE=$image"
fi
if [ -n "${PIP_CERT:-}" ] && [ "$builder" != docker ]; then
    printf '[global]\ncert = /etc/host-certificates.crt\n' > "$folder/pip.conf"
    set -- "$@" --volume "$PIP_CERT:/etc/host-certificates.crt:ro" --volume "$folder/pip.conf:/etc/pip.conf:ro"
fi
echo "builder: $builder"
if [ "$builder" = buildah ]; then
    buildah build --layers "$@" .
    # buildah runs no entry point: the same command, as the same user.
    box=$(buildah from roundel)
    chown 1000:1000 "$out" # the container's user
    buildah run --volume "$out:/out" "$box" -- roundel run demo /out/demo
    buildah rm "$box" >/dev/null
else
    "$builder" build "$@" .
    chmod a+rwx "$out"
    "$builder" run --rm --volume "$out:/out" roundel
fi
test -s "$out/demo/report/report.html"
echo "container: built, and its demo is in $out/demo"
