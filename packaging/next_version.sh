#!/usr/bin/env bash
# Repack a package under the next version, for trying an upgrade:
#
#   packaging/next_version.sh dist/imu-tracker_1.0+deb13_amd64.deb next.deb
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
dpkg-deb -R "$1" "$work/tree"
sed -i 's/^Version: \(.*\)+deb/Version: \1+next+deb/' "$work/tree/DEBIAN/control"
dpkg-deb --root-owner-group -Zgzip -z1 -b "$work/tree" "$2" >/dev/null
