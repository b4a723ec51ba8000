#!/usr/bin/env bash
# Build one Debian package, by dpkg-buildpackage and debhelper, on any Debian or Ubuntu:
#
#   packaging/build_deb.sh 13 arm64     # for Debian 13, 64-bit Raspberry Pi OS
#
# The package has all its libraries in /usr/lib/imu-tracker, from the wheels that PyPI has
# for that Python and that processor, in the versions and with the hashes of
# requirements-dev.txt: it installs without a network, and nothing is compiled, neither
# here nor on the Pi. PYTHON names one with imu-tracker and its extra "package".
set -euo pipefail
umask 022
cd "$(dirname "${BASH_SOURCE[0]}")/.."

debian=${1:?which Debian: 12 or 13}
arch=${2:?which processor: arm64 or amd64}
python=${PYTHON:-.venv/bin/python}
case $debian in
    12) version=3.11 next=3.12 glibc=2.36 ;;
    13) version=3.13 next=3.14 glibc=2.41 ;;
    *) echo "Debian $debian is not known here: 12 or 13" >&2; exit 2 ;;
esac
case $arch in
    arm64) machine=aarch64 ;;
    amd64) machine=x86_64 ;;
    *) echo "$arch is not known here: arm64 or amd64" >&2; exit 2 ;;
esac
for program in dpkg-buildpackage:dpkg-dev dh:debhelper; do
    command -v "${program%:*}" >/dev/null || {
        echo "${program%:*} is missing: sudo apt install ${program#*:}" >&2; exit 1; }
done

release=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' src/imu_tracker/__init__.py)
# A version of Python as one of Debian: what comes before a release sorts before it.
package_version=$(sed -E 's/\.?(dev|a|b|rc)/~\1/' <<<"$release")+deb$debian
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct 2>/dev/null || date +%s)
export SOURCE_DATE_EPOCH

build=build/deb/$debian-$arch
tree=$build/imu-tracker-$release
rm -rf "$build"
mkdir -p "$tree" dist

# ------------------------------------------------------------------------- wheels
pip=("$python" -m pip --disable-pip-version-check --quiet)
pins=build/pins.txt
sed -n 's/^\([A-Za-z0-9._-]*==[^ ]*\).*/\1/p' requirements-dev.txt >"$pins"
pure=build/wheels/pure
mkdir -p "$pure"
rm -f "$pure"/imu_tracker-*.whl
"${pip[@]}" wheel --no-deps --wheel-dir "$pure" .
# These two have no wheel on PyPI; they are pure Python, and pip makes it anywhere.
"${pip[@]}" wheel --no-deps --constraint "$pins" --wheel-dir "$pure" filterpy sdnotify

wheels=build/wheels/$debian-$arch
platforms=()
for minor in $(seq 17 "${glibc#2.}"); do
    platforms+=(--platform "manylinux_2_${minor}_$machine")
done
target=("${platforms[@]}" --platform "manylinux2014_$machine" --implementation cp
    --python-version "$version" --only-binary :all:)
rm -rf "$wheels"
"${pip[@]}" download "${target[@]}" --find-links "$pure" --constraint "$pins" \
    --dest "$wheels" "$(echo "$pure"/imu_tracker-*.whl)[mqtt]"
for wheel in "$wheels"/*.whl; do
    [[ -e $pure/$(basename "$wheel") ]] && continue
    grep -q "sha256:$(sha256sum "$wheel" | cut -d ' ' -f 1)" requirements-dev.txt ||
        { echo "$wheel: its hash is not in requirements-dev.txt" >&2; exit 1; }
done

# --------------------------------------------------------------------------- tree
"${pip[@]}" install "${target[@]}" --no-deps --no-compile --no-index \
    --target "$tree/site" "$wheels"/*.whl
# What no tracker runs: the tests of the libraries, what compilers and type checkers read.
rm -rf "$tree/site/bin" "$tree/site/numpy/_core/include"
find "$tree/site" -depth -type d \( -name tests -o -name sample_data \) \
    -exec rm -rf {} +
find "$tree/site" -type f \( -name '*.pyi' -o -name '*.pxd' -o -name '*.pyx' \
    -o -name '*.h' -o -name '*.a' -o -name '*.lib' \) -delete

"$python" packaging/documents.py "$tree/documents"
cp -r packaging/debian "$tree/debian"
cp -r systemd config README.md CHANGELOG.md LICENSE "$tree"
cat >"$tree/debian/changelog" <<TEXT
imu-tracker ($package_version) stable; urgency=medium

  * Release $release: see /usr/share/doc/imu-tracker/CHANGELOG.md.gz.

 -- The imu-tracker authors <imu-tracker@users.noreply.github.com>  $(date --utc --rfc-email --date "@$SOURCE_DATE_EPOCH")
TEXT
echo "python:Depends=python3 (>= $version~), python3 (<< $next)" >"$tree/debian/python.substvars"

(cd "$tree" && dpkg-buildpackage --build=binary --host-arch "$arch" --no-sign -d \
    >../build.log 2>&1) || { tail -n 30 "$build/build.log" >&2; exit 1; }
mv "$build/imu-tracker_${package_version}_$arch.deb" dist/
echo "dist/imu-tracker_${package_version}_$arch.deb"
