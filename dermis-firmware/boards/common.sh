# Sourced by `check` and `touches`: a folder for files, the boards' images, and devices that are ended with the script.
# `dermis` is the program; the current folder is that of the boards.

work=$(mktemp -d)
running=()
finish() {
  for id in "${running[@]}"; do kill "$id" 2>/dev/null || true; done
  rm -rf "$work"
}
trap finish EXIT

# Of its own: the build of the workspace must not see the boards' flags.
built=${CARGO_TARGET_DIR:-$PWD/target}/boards
pico=$built/thumbv6m-none-eabi/release/dermis-board-pico

# The tables of the skin, in its own file, which the boards and the Pico's emulator read.
mkdir -p skins
"$dermis" scan-table cylinder30 --firmware --twin reader.toml -o skins/cylinder30.rs

build() {
  (cd "$1" && CARGO_TARGET_DIR=$built cargo build --quiet --locked --release)
}

# The electronics with lines that settle at once: `dermis emulate` gives all slots the same time, the firmware the time that
# each needs, so that readings of lines with capacitance differ by a count.
settle() {
  sed 's/^line_capacitance_f = 250e-12/line_capacitance_f = 0.0/' reader.toml >"$work/settled.toml"
  grep -q '^line_capacitance_f = 0.0' "$work/settled.toml"
}

# Starts a device that prints its address, and sets `address`.
start() {
  coproc DEVICE { exec "$@" 2>&1; }
  device=$DEVICE_PID from=${DEVICE[0]} to=${DEVICE[1]}
  running+=("$device")
  read -r address <&"$from"
}

end() {
  kill "$device"
  wait "$device" 2>/dev/null || true
}

# The Pico with a file of readings.
start_pico() {
  (cd pico/emulator && npm ci --silent)
  start node pico/emulator/emulate.mjs "$pico" "$1" skins/cylinder30.rs 0
}

# The end of its input ends the Pico; it reports its front end, and fails if anything was wrong there.
end_pico() {
  exec {to}>&-
  cat <&"$from"
  wait "$device"
}
