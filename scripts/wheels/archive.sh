#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# apt-get over Debian's archive, whatever lists, packages and architecture this machine has:
# archive.sh SUITE ARCHITECTURE FOLDER ARGUMENTS... Lists and packages stay in FOLDER.
set -euo pipefail
suite=$1 architecture=$2 folder=$(mkdir -p "$3"/{lists,archives}/partial && readlink -f "$3")
shift 3
options=(-qq -y -o "Dir::Etc::sourcelist=$folder/sources" -o Dir::Etc::sourceparts=/dev/null -o "Dir::State::lists=$folder/lists"
  -o "Dir::State::status=$folder/status" -o "Dir::Cache::archives=$folder/archives" -o Dir::Cache::pkgcache= -o Dir::Cache::srcpkgcache=
  -o "APT::Architecture=$architecture" -o "APT::Architectures::=$architecture" -o APT::Sandbox::User=root -o APT::Install-Recommends=false -o Debug::NoLocking=1)
if [ ! -e "$folder/status" ]; then
  printf '%s [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian '"$suite"' main\n' deb deb-src >"$folder/sources"
  apt-get "${options[@]}" update
  touch "$folder/status"
fi
exec apt-get "${options[@]}" "$@"
