// One WebSocket that reconnects. Only the newest frame is kept: a page that draws slowly skips frames and builds no
// backlog.

import type { Command, RefusedMessage, SceneMessage, StatusMessage } from "./types";

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 4000;
/** The server sends a status four times a second; after this time without a message the page reconnects. */
const SILENCE_MS = 6000;
/** No move of a press is sent while this much is queued: the next one replaces it. */
const SEND_QUEUE_BYTES = 65536;

export interface Listener<Scene, Status> {
  setScene(scene: Scene): void;
  setStatus(status: Status): void;
  refused(refused: RefusedMessage): void;
  connected(): void;
  /** The connection is lost; the next attempt is in `waitMs`. */
  disconnected(waitMs: number): void;
}

/** `Scene` and `Status` are the messages of the page's server. */
export class Connection<Scene extends { type: "scene" } = SceneMessage, Status extends { type: "status" } = StatusMessage> {
  private socket: WebSocket | null = null;
  private newest: ArrayBuffer | null = null;
  private waitMs = FIRST_WAIT_MS;
  private timer: number | undefined;
  private watchdog: number | undefined;
  private lastScene = "";
  private up = false;

  constructor(
    private readonly address: string,
    private readonly listener: Listener<Scene, Status>,
  ) {}

  get connected(): boolean {
    return this.up;
  }

  open(): void {
    window.clearTimeout(this.timer);
    this.drop();
    const socket = new WebSocket(this.address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.watchSilence();
    socket.onmessage = (event) => this.receive(event.data as string | ArrayBuffer);
    socket.onclose = () => this.lost();
    socket.onerror = () => socket.close();
  }

  /** The newest frame not yet taken. */
  take(): ArrayBuffer | null {
    const frame = this.newest;
    this.newest = null;
    return frame;
  }

  send(command: Command): boolean {
    const { socket } = this;
    if (!this.up || !socket || socket.readyState !== WebSocket.OPEN) return false;
    if (command.do === "press" && socket.bufferedAmount > SEND_QUEUE_BYTES) return false;
    socket.send(JSON.stringify(command));
    return true;
  }

  private receive(data: string | ArrayBuffer): void {
    this.receivedAt = performance.now();
    if (typeof data !== "string") {
      this.newest = data;
      return;
    }
    const message = JSON.parse(data) as Scene | Status | RefusedMessage;
    if (message.type === "scene") this.receiveScene(data, message);
    else if (message.type === "status") this.listener.setStatus(message);
    else this.listener.refused(message);
  }

  private receiveScene(data: string, scene: Scene): void {
    if (data !== this.lastScene) {
      this.lastScene = data;
      this.newest = null;
      this.listener.setScene(scene);
    }
    this.waitMs = FIRST_WAIT_MS;
    if (!this.up) {
      this.up = true;
      this.listener.connected();
    }
  }

  private receivedAt = 0;

  private watchSilence(): void {
    window.clearInterval(this.watchdog);
    this.receivedAt = performance.now();
    this.watchdog = window.setInterval(() => {
      if (performance.now() - this.receivedAt > SILENCE_MS) this.lost();
    }, 1000);
  }

  private lost(): void {
    this.drop();
    this.up = false;
    this.newest = null;
    this.listener.disconnected(this.waitMs);
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.open(), this.waitMs);
    this.waitMs = Math.min(2 * this.waitMs, LONGEST_WAIT_MS);
  }

  private drop(): void {
    window.clearInterval(this.watchdog);
    const { socket } = this;
    if (!socket) return;
    socket.onmessage = socket.onclose = socket.onerror = null;
    socket.close();
    this.socket = null;
  }
}

/** The WebSocket of the page's own server, with the token of the page's address. */
export function liveAddress(location: Location): string {
  const token = new URLSearchParams(location.search).get("token");
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  return `${scheme}//${location.host}/live${token === null ? "" : `?token=${encodeURIComponent(token)}`}`;
}
