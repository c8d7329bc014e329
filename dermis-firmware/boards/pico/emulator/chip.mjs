// The chip: rp2040js, with what it lacks mended here.
// 1. Its PIO runs on timers of the host computer: here in the simulated time, cycle by cycle (clock divider 1).
// 2. It takes a USB OUT buffer from the program at once, and completes it with nothing: here when data have come.
// 3. Its USB IN packets take no time: here as long as on a full-speed bus.
// 4. Its host sets DTR as a request to the device, once and for all: here to the interface, when a program opens the port.

import { readElf } from '../../elf.mjs';
import {
  ConsoleLogger, createSetupPacket, DataDirection, LogLevel, RP2040, SetupRecipient, SetupType, USBCDC,
} from 'rp2040js';

export const CYCLE_NS = 8;
const FLASH = 0x10000000;
/** Start of the program after the second stage of the boot. */
const VECTORS = FLASH + 0x100;
/** A full-speed bus carries at most 19 bulk packets of 64 bytes in a frame of 1 ms (USB 2.0, table 5-9). */
const PACKET_NS = 1e6 / 19;
const AVAILABLE = 1 << 10;
const OUT_CONTROL = 0x84;

/** Copies the loadable segments of an ELF file into the flash. */
function load(chip, path) {
  const { elf, segments } = readElf(path);
  for (const { offset, address, bytes } of segments) chip.flash.set(elf.subarray(offset, offset + bytes), address - FLASH);
}

export class Chip {
  /** A chip with a program; `pinsChanged(pins, cycle)` follows its outputs, `data()` is the state of its input. */
  constructor(path, { pinsChanged, data }) {
    const chip = (this.chip = new RP2040());
    chip.logger = new ConsoleLogger(LogLevel.Error, true);
    load(chip, path);
    chip.core.VTOR = VECTORS;
    chip.core.SP = chip.readUint32(VECTORS);
    chip.core.PC = chip.readUint32(VECTORS + 4) & ~1;
    this.clock = chip.clock;
    this.watchdog = 0;
    chip.peripherals[0x40058].onWatchdogTrigger = () => (this.watchdog += 1);
    this.mendPio(pinsChanged, data);
    this.mendUsb();
  }

  get nanos() {
    return this.clock.nanos;
  }

  mendPio(pinsChanged, data) {
    const pio = (this.pio = this.chip.pio[0]);
    const machine = (this.machine = pio.machines[0]);
    pio.run = () => {};
    pio.checkChangedPins = () => pinsChanged(pio.pinValues, Math.round(this.readyNs / CYCLE_NS));
    Object.defineProperty(machine, 'inPins', { get: data });
    /** When the next instruction is executed, and whether the machine waits for its queues. */
    this.readyNs = 0;
    this.stalled = true;
  }

  /** Executes the next instruction of the state machine. */
  stepPio() {
    const { machine, pio } = this;
    const opcode = pio.instructions[machine.pc];
    // `jmp x--` to itself: nothing happens until x is zero.
    if (opcode >>> 13 === 0 && ((opcode >>> 5) & 7) === 2 && (opcode & 0x1f) === machine.pc && machine.x > 0) {
      const delay = (opcode >>> 8) & 7;
      this.readyNs += machine.x * (1 + delay) * CYCLE_NS;
      machine.x = 0;
      return;
    }
    const before = machine.cycles;
    machine.step();
    pio.checkChangedPins();
    this.readyNs += (machine.cycles - before) * CYCLE_NS;
    this.stalled = machine.waiting;
  }

  /** When the state machine does something next; infinity if it does not run. */
  nextPioNs() {
    const { machine } = this;
    if (!machine.enabled || machine.waiting) {
      this.stalled = true;
      return Infinity;
    }
    if (this.stalled) {
      // It was enabled, or its queue got a word; the instruction that waited is complete.
      this.stalled = false;
      this.readyNs = Math.max(this.readyNs, this.clock.nanos + CYCLE_NS * (1 + Math.max(machine.waitDelay, 0)));
    }
    return this.readyNs;
  }

  /** Runs everything but the processor until a time, or until it is woken. */
  advance(untilNs, wakes) {
    const { clock } = this;
    for (;;) {
      if (wakes && !this.chip.core.waiting) return;
      const pioNs = this.nextPioNs();
      const alarmNs = clock.nextAlarm?.nanos ?? Infinity;
      const nextNs = Math.max(Math.min(pioNs, alarmNs), clock.nanos);
      if (nextNs > untilNs) {
        clock.tick(untilNs - clock.nanos);
        return;
      }
      if (alarmNs <= nextNs) clock.tick(nextNs - clock.nanos);
      else {
        clock.nanosCounter = nextNs;
        this.stepPio();
      }
    }
  }

  /** Runs for a simulated time, ns. */
  run(forNs) {
    const { core } = this.chip;
    const endNs = this.clock.nanos + forNs;
    while (this.clock.nanos < endNs) {
      if (core.waiting) this.advance(endNs, true);
      else this.advance(this.clock.nanos + core.executeInstruction() * CYCLE_NS, false);
    }
  }

  mendUsb() {
    const usb = this.chip.usbCtrl;
    const memory = this.chip.usbDPRAMView;
    const updated = usb.DPRAMUpdated.bind(usb);
    this.queue = [];
    this.wanted = null;
    usb.DPRAMUpdated = (offset, value) => {
      const isOut = (offset & 4) !== 0;
      const endpoint = (offset - 0x80) >> 3;
      const isBulk = value & AVAILABLE && offset >= 0x88 && offset <= 0xfc;
      if (!isBulk) updated(offset, value);
      else if (isOut) {
        this.wanted = { endpoint, size: value & 0x3ff };
        this.feed();
      } else this.take(endpoint, offset, value);
    };
    const finish = usb.finishRead.bind(usb);
    usb.finishRead = (endpoint, buffer) => {
      const at = OUT_CONTROL + 8 * endpoint;
      memory.setUint32(at, memory.getUint32(at, true) & ~AVAILABLE, true);
      finish(endpoint, buffer);
    };
    this.cdc = new USBCDC(usb);
    this.cdc.cdcSetControlLineState = () => {
      this.cdc.initialized = true;
    };
    this.cdc.onDeviceConnected = () => this.onEnumerated?.();
    usb.onEndpointRead = () => {};
  }

  /** A bulk IN packet: on the bus, then complete. */
  take(endpoint, offset, value) {
    const usb = this.chip.usbCtrl;
    const memory = this.chip.usbDPRAMView;
    const start = usb.getEndpointBufferOffset(endpoint, false);
    const packet = this.chip.usbDPRAM.slice(start, start + (value & 0x3ff));
    this.inAlarms ??= new Map();
    if (!this.inAlarms.has(endpoint)) {
      this.inAlarms.set(endpoint, this.clock.createAlarm(() => this.inAlarms.get(endpoint).done()));
    }
    const alarm = this.inAlarms.get(endpoint);
    alarm.done = () => {
      memory.setUint32(offset, value & ~(AVAILABLE | (1 << 15)), true);
      usb.indicateBufferReady(endpoint, false);
      if (endpoint === this.cdc.inEndpoint && packet.length > 0) this.onData?.(packet);
    };
    alarm.schedule(PACKET_NS);
  }

  /** Gives waiting data to a buffer that wants them. */
  feed() {
    if (this.wanted?.endpoint !== this.cdc.outEndpoint || this.queue.length === 0) return;
    const { endpoint, size } = this.wanted;
    this.wanted = null;
    const packet = Uint8Array.from(this.queue.splice(0, Math.min(size, 64)));
    this.chip.usbCtrl.endpointReadDone(endpoint, packet, PACKET_NS / 1e3);
  }

  /** A program opens the port, or closes it. */
  setOpened(opened) {
    if (!opened) this.queue.length = 0;
    const { HostToDevice } = DataDirection;
    const [type, recipient] = [SetupType.Class, SetupRecipient.Interface];
    const setControlLineState = { dataDirection: HostToDevice, type, recipient, bRequest: 0x22, wValue: opened ? 3 : 0, wIndex: 0, wLength: 0 };
    this.chip.usbCtrl.sendSetupPacket(createSetupPacket(setControlLineState));
  }

  /** Sends bytes to the device. */
  send(bytes) {
    for (const byte of bytes) this.queue.push(byte);
    this.feed();
  }
}
