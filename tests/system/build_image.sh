#!/usr/bin/env bash
# Build the machine that the tests of this directory boot: a Debian kernel, a small
# initial RAM disk, a root file system like that of Raspberry Pi OS Lite, and the package
# of this checkout. Debian packages and PyPI wheels only: no kernel is compiled, nothing
# is mounted. What is there already is kept; remove the directory to begin anew.
#
#   tests/system/build_image.sh     # into ~/.cache/imu-tracker-system-12, or -13 for the
#                                   # Debian that IMU_TRACKER_SYSTEM_DEBIAN names
#
# Must be root: mmdebstrap, chroot and the owners of the files in the image ask for it.
set -euo pipefail

HERE=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
CHECKOUT=$(cd "$HERE/../.." && pwd)
BUILD=${IMU_TRACKER_SYSTEM_BUILD:-${XDG_CACHE_HOME:-$HOME/.cache}/imu-tracker-system}
IMAGE_MB=2000

# What each program is for, and the package that has it.
declare -A PACKAGE_OF=(
    [qemu-system-x86_64]=qemu-system-x86 [qemu-img]=qemu-utils
    [mmdebstrap]=mmdebstrap [mke2fs]=e2fsprogs
    [dh]=debhelper [dpkg-buildpackage]=dpkg-dev [busybox]=busybox-static [cpio]=cpio [modprobe]=kmod
)
PATH=$PATH:/usr/sbin:/sbin
missing=()
for program in "${!PACKAGE_OF[@]}"; do
    command -v "$program" >/dev/null || missing+=("${PACKAGE_OF[$program]}")
done
if ((${#missing[@]})); then
    echo "the system tests need more Debian packages:" \
        "sudo apt install ${missing[*]}" >&2
    exit 1
fi
if ((EUID != 0)); then
    echo "the system tests build a root file system: run them as root" >&2
    exit 1
fi

debian=${IMU_TRACKER_SYSTEM_DEBIAN:-$(cut -d . -f 1 /etc/debian_version)}
case $debian in
    12) suite=bookworm ;;
    13) suite=trixie ;;
    *)
        echo "the system tests know Debian 12 and 13: IMU_TRACKER_SYSTEM_DEBIAN=13" >&2
        exit 1
        ;;
esac
# One folder for each: the kernel is this machine's own, the rest is that Debian's.
BUILD=$BUILD-$debian

stage() { printf '[%4d s] %s\n' "$SECONDS" "$*"; }
key_of() { cat "$@" | sha256sum | cut -d ' ' -f 1; }
is_made() { [[ -e $1.key && $(<"$1.key") == "$2" ]]; }
made() { echo "$2" >"$1.key"; }

mkdir -p "$BUILD"
cd "$BUILD"

# ------------------------------------------------------------------------- kernel
# linux-image-cloud-amd64 is of no use here: it has no I2C.
if [[ ! -e kernel.key ]]; then
    stage "the kernel: download and unpack"
    package=$(apt-cache depends linux-image-amd64 | awk '/Depends: linux-image/ {print $2; exit}')
    rm -rf kernel debs
    mkdir debs kernel
    (cd debs && apt-get download -q -o APT::Sandbox::User=root "$package")
    dpkg -x debs/"$package"_*.deb kernel
    if [[ -d kernel/usr/lib/modules ]]; then # the layout of trixie
        mkdir -p kernel/lib
        mv kernel/usr/lib/modules kernel/lib/
    fi
    version=${package#linux-image-}
    depmod -b kernel "$version"
    cp "kernel/boot/vmlinuz-$version" vmlinuz
    made kernel "$version"
fi
version=$(<kernel.key)

# ------------------------------------------------------------------------ package
# What a Pi gets, for this processor; and the version after it, for an upgrade.
stage "the package of this checkout"
file=$("$CHECKOUT/packaging/build_deb.sh" "$debian" amd64 | tail -n 1)
rm -rf packages
mkdir packages
cp "$CHECKOUT/$file" packages/imu-tracker.deb
"$CHECKOUT/packaging/next_version.sh" packages/imu-tracker.deb packages/next.deb

# ------------------------------------------------------------- base of the root
packages=systemd,systemd-sysv,udev,kmod,dbus,sudo,procps,python3
key=$suite,$packages
if ! is_made base.tar "$key"; then
    stage "the root file system of Debian $suite"
    mirror=$(apt-get indextargets --format "\$(REPO_URI)" | head -n 1) # where apt goes
    mmdebstrap --variant=minbase --quiet \
        --include="$packages" \
        --aptopt='Acquire::Languages "none"' --dpkgopt=force-unsafe-io \
        --dpkgopt='path-exclude=/usr/share/man/*' \
        --dpkgopt='path-exclude=/usr/share/doc/*' \
        --dpkgopt='path-exclude=/usr/share/locale/*' \
        "$suite" base.tar "$mirror" 2>mmdebstrap.log ||
        { tail -n 20 mmdebstrap.log >&2; exit 1; }
    made base.tar "$key"
fi

# ------------------------------------------------------------------------ image
key=$(key_of "$HERE/build_image.sh" "$HERE/guest/agent.py" base.tar.key kernel.key)
if is_made rootfs.ext4 "$key"; then
    stage "the image is there already: $BUILD"
    exit 0
fi
stage "the root file system: unpack and adapt"
rm -rf root
mkdir root
tar -C root -xf base.tar

insmods() { # the files of some modules and of what these need, in order of loading
    local module
    for module in "$@"; do
        modprobe -d kernel -S "$version" --show-depends "$module" |
            awk '$1 == "insmod" {print $2}'
    done | awk '!seen[$0]++'
}
insmods virtio_pci virtio_blk virtio_console virtio_rng ext4 9p 9pnet_virtio \
    i2c-dev i2c-i801 i2c-tiny-usb vhci-hcd usbserial cdc_acm |
    while read -r file; do
        install -D -m 644 "$file" "root/lib/modules/$version/${file#*"/$version/"}"
    done
cp kernel/lib/modules/"$version"/modules.{builtin,order}* "root/lib/modules/$version/"
depmod -b root "$version"
# The adapters are loaded by hand: the second of them is number 1, as on a Pi.
printf 'blacklist %s\n' i2c_i801 i2c_tiny_usb >root/etc/modprobe.d/imu-tracker-test.conf

# Groups, device names and a user like those of Raspberry Pi OS.
chroot root groupadd --force --system i2c
chroot root useradd --create-home --groups sudo,dialout,i2c --shell /bin/bash pi
echo 'pi ALL=(ALL) NOPASSWD: ALL' >root/etc/sudoers.d/pi
cat >root/etc/udev/rules.d/99-pi.rules <<'RULES'
SUBSYSTEM=="i2c-dev", GROUP="i2c", MODE="0660"
SUBSYSTEM=="tty", KERNEL=="ttyS1", SYMLINK+="serial0", GROUP="dialout", MODE="0660"
RULES
echo imu-tracker-test >root/etc/hostname
echo '127.0.0.1 localhost imu-tracker-test' >root/etc/hosts
mkdir -p root/mnt/host root/var/log/journal
cat >root/etc/fstab <<'TABLE'
/dev/vda / ext4 defaults,errors=remount-ro 0 1
host /mnt/host 9p trans=virtio,version=9p2000.L,ro,msize=262144 0 0
TABLE
for unit in apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer \
    e2scrub_all.timer e2scrub_reap.service fstrim.timer getty@tty1.service \
    serial-getty@ttyS0.service systemd-networkd-wait-online.service; do
    ln -sf /dev/null "root/etc/systemd/system/$unit"
done
ln -sf /lib/systemd/system/multi-user.target root/etc/systemd/system/default.target

# The hand of the tests in there.
install -m 755 "$HERE/guest/agent.py" root/usr/local/sbin/imu-tracker-test-agent
cat >root/etc/systemd/system/imu-tracker-test-agent.service <<'UNIT'
[Unit]
Description=does what the tests say
RequiresMountsFor=/mnt/host
Before=imu-tracker.service

[Service]
# What a power cut left, as it was before the daemon mended it.
ExecStartPre=-/bin/cp -a -t /run/before /var/log/imu-tracker
ExecStartPre=-/bin/cp -a -T /var/lib/imu-tracker /run/before/state
RuntimeDirectory=before
RuntimeDirectoryPreserve=yes
ExecStart=/usr/local/sbin/imu-tracker-test-agent
Restart=always
Nice=-10
KillMode=process

[Install]
WantedBy=multi-user.target
UNIT
chroot root systemctl --quiet enable imu-tracker-test-agent.service

rm -rf root/var/lib/apt/lists/*

stage "the image"
rm -f rootfs.ext4 rootfs.ext4.key
truncate -s "${IMAGE_MB}M" rootfs.ext4
mke2fs -q -t ext4 -L rootfs -E lazy_itable_init=0,lazy_journal_init=0 -d root rootfs.ext4
rm -rf root

# ------------------------------------------------------------- initial RAM disk
rm -rf initrd
mkdir -p initrd/{bin,dev,proc,sys,newroot,modules}
cp "$(command -v busybox)" initrd/bin/busybox
insmods virtio_pci virtio_blk ext4 | while read -r file; do
    name=$(basename "$file")
    cp "$file" initrd/modules/
    case $name in
        *.xz) unxz "initrd/modules/$name" && name=${name%.xz} ;;
        *.zst) unzstd -q --rm "initrd/modules/$name" && name=${name%.zst} ;;
    esac
    echo "$name" >>initrd/order
done
cat >initrd/init <<'INIT'
#!/bin/busybox sh
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
/bin/busybox mount -t devtmpfs dev /dev
while read -r name; do /bin/busybox insmod "/modules/$name"; done </order
tries=0
while [ ! -b /dev/vda ] && [ $tries -lt 600 ]; do
    /bin/busybox usleep 50000
    tries=$((tries + 1))
done
/bin/busybox mount -t ext4 -o rw /dev/vda /newroot || exec /bin/busybox sh
/bin/busybox umount /proc
/bin/busybox umount /sys
/bin/busybox mount --move /dev /newroot/dev
exec /bin/busybox switch_root /newroot /sbin/init
INIT
chmod 755 initrd/init
(cd initrd && find . | cpio -o -H newc --quiet | gzip -1) >initrd.img
rm -rf initrd
made rootfs.ext4 "$key"
stage "done: $BUILD"
