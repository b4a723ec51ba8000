#!/usr/bin/env bash
# Try a package in a Debian of its own, without a network: install, check, rows, upgrade,
# remove, purge. As root; debootstrap makes the Debian, once.
#
#   packaging/try_deb.sh 13 dist/imu-tracker_*+deb13_amd64.deb
#
# Prints a line for each thing that holds, with sizes and times; ends at the first that
# does not. A service manager is not in there: `make system-test` has one.
set -euo pipefail

debian=${1:?which Debian: 12 or 13}
deb=$(realpath "${2:?which package}")
case $debian in 12) suite=bookworm ;; 13) suite=trixie ;; *) exit 2 ;; esac
cache=${XDG_CACHE_HOME:-$HOME/.cache}/imu-tracker-deb
base=$cache/$suite
mkdir -p "$cache"
if [[ ! -e $base.done ]]; then
    rm -rf "$base"
    mirror=$(apt-get indextargets --format "\$(REPO_URI)" | head -n 1) # where apt goes
    debootstrap --variant=minbase --include=python3,systemd,sudo,passwd \
        "$suite" "$base" "$mirror" >"$cache/debootstrap.log" ||
        { tail -n 20 "$cache/debootstrap.log" >&2; exit 1; }
    touch "$base.done"
fi

root=$cache/try-$$
trap 'umount -q "$root/dev" "$root/proc" || true; rm -rf "$root"' EXIT
cp -a "$base" "$root"
mount -t proc proc "$root/proc"
mount --bind /dev "$root/dev"
cp "$deb" "$root/root/first.deb"

"$(dirname "$0")/next_version.sh" "$deb" "$root/root/next.deb"

in_there() { # without a network, as on a Pi in a field
    unshare --net chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 \
        DEBIAN_FRONTEND=noninteractive HOME=/root "$@"
}
holds() { # a sentence, and what must be true
    local sentence=$1
    shift
    "$@" || { echo "NOT TRUE: $sentence" >&2; exit 1; }
    echo "ok: $sentence"
}
code_of() { in_there "$@" >"$root/root/said" 2>&1 && echo 0 || echo $?; }
is_there() { [[ -e $root$1 ]]; }
is_gone() { ! is_there "$1"; }
mode_of() { chroot "$root" stat -c '%a %U:%G' "$1"; }

start=$SECONDS
in_there apt-get install -y --no-install-recommends /root/first.deb >"$root/root/said" 2>&1 ||
    { tail -n 20 "$root/root/said" >&2; exit 1; }
echo "measured: installed in $((SECONDS - start)) s," \
    "$(du -sm "$root/usr/lib/imu-tracker" | cut -f 1) MB below /usr/lib/imu-tracker," \
    "package $(($(stat -c %s "$deb") / 1000000)) MB"
holds "the advice is printed" grep -q "sudo imu-tracker setup" "$root/root/said"
holds "it says its version" in_there imu-tracker --version
holds "there is a man page" is_there /usr/share/man/man1/imu-tracker.1.gz
holds "bash completes it" bash -n "$root/usr/share/bash-completion/completions/imu-tracker"
holds "the user is in the groups of the devices" \
    bash -c "[[ '$(chroot "$root" id -Gn imu-tracker)' == *i2c* && '$(chroot "$root" id -Gn imu-tracker)' == *dialout* ]]"
for place in /var/log/imu-tracker /var/lib/imu-tracker; do
    holds "$place is the daemon's" test "$(mode_of $place)" = "750 imu-tracker:imu-tracker"
done
for unit in "$root"/usr/lib/systemd/system/imu-tracker*.service; do
    unit=$(basename "$unit")
    holds "$unit is disabled" test "$(chroot "$root" systemctl is-enabled "$unit" || true)" = disabled
done
holds "without sensors check ends with 69" test "$(code_of imu-tracker check)" = 69
holds "check finds its configuration" grep -q "/etc/imu-tracker/imu-tracker.toml" "$root/root/said"
holds "check names the setup" grep -q "imu-tracker setup" "$root/root/said"
holds "setup on another computer changes nothing" test "$(code_of imu-tracker setup --dry-run)" = 69

as_daemon=(runuser -u imu-tracker -- env OPENBLAS_NUM_THREADS=1)
config=(--config /etc/imu-tracker/imu-tracker.toml)
played=(--set source.kind=simulation --set source.speed=30 --set source.duration_s=120
    --set log.min_free_mb=0 --set status.path=/tmp/status.json)
holds "check with a simulated source ends with 0" \
    test "$(code_of "${as_daemon[@]}" imu-tracker check "${config[@]}" "${played[@]}")" = 0
measured='import resource, subprocess, sys, time
start = time.monotonic()
code = subprocess.call(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(f"measured: two simulated minutes in {time.monotonic() - start:.0f} s,"
      f" {used.ru_utime:.0f} s of CPU, {used.ru_maxrss // 1024} MB at most")
sys.exit(code)'
holds "it runs to the end" test "$(code_of "${as_daemon[@]}" \
    python3 -c "$measured" imu-tracker run "${config[@]}" "${played[@]}")" = 0
grep measured: "$root/root/said"
log=$root/var/log/imu-tracker/latlong.csv
rows() { wc -l <"$log"; }
holds "the log has rows" test "$(rows)" -gt 100
before=$(rows)

# What somebody changed, and what was learnt, outlast the next version.
echo "# mine" >>"$root/etc/imu-tracker/imu-tracker.toml"
in_there apt-get install -y /root/next.deb >"$root/root/said" 2>&1 ||
    { tail -n 20 "$root/root/said" >&2; exit 1; }
holds "an upgrade keeps the configuration" grep -q "# mine" "$root/etc/imu-tracker/imu-tracker.toml"
holds "an upgrade keeps the log" test "$(rows)" = "$before"
holds "an upgrade keeps the state" is_there /var/lib/imu-tracker/state.json
holds "the next version is there" bash -c "chroot $root dpkg-query -W imu-tracker | grep -q next"

in_there apt-get remove -y imu-tracker >"$root/root/said" 2>&1
holds "remove takes the program" is_gone /usr/bin/imu-tracker
holds "remove takes the libraries, compiled files too" is_gone /usr/lib/imu-tracker
holds "remove keeps the configuration" is_there /etc/imu-tracker/imu-tracker.toml
holds "remove keeps the log" test "$(rows)" = "$before"

in_there apt-get purge -y imu-tracker >"$root/root/said" 2>&1
holds "purge takes the configuration" is_gone /etc/imu-tracker
holds "purge takes the state" is_gone /var/lib/imu-tracker
holds "purge keeps the log" test "$(rows)" = "$before"

in_there apt-get install -y /root/first.deb >/dev/null 2>&1
in_there env IMU_TRACKER_PURGE_LOGS=yes apt-get purge -y imu-tracker >/dev/null 2>&1
holds "purge takes the log when it is told to" is_gone /var/log/imu-tracker
