// The connection: messages out, answers in, again and again after a break. Of messages that replace each other, as
// while a slider is dragged, only the newest waits.

export class Talk {
  constructor({ onMessage, onBroken, onOpen }) {
    Object.assign(this, { onMessage, onBroken, onOpen });
    this.number = 0;
    this.waiting = new Map();
    this.newest = null;
    this.failures = 0;
    this.tab = sessionStorage.getItem("tab") || this.#rename(crypto.randomUUID());
    this.#open();
  }

  #rename(tab) {
    sessionStorage.setItem("tab", tab);
    return (this.tab = tab);
  }

  #open() {
    const socket = new WebSocket(`ws://${location.host}/talk?tab=${this.tab}`);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.failures = 0;
      this.waiting.clear();
      this.newest = null;
      this.onOpen();
      this.send({ type: "hello" });
    };
    socket.onmessage = (event) => this.#receive(event.data);
    socket.onclose = () => {
      this.failures += 1;
      this.onBroken(this.failures);
      setTimeout(() => this.#open(), Math.min(5000, 300 * this.failures));
    };
  }

  #receive(buffer) {
    const view = new DataView(buffer), number = view.getUint32(0, true), size = view.getUint32(4, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, size)));
    const floats = new Float32Array(buffer, 8 + size);
    if (head.type === "tab") { this.#rename(head.tab); return; }
    this.waiting.delete(number);
    if (this.newest && this.waiting.size === 0) { // before this answer is drawn, so that server and page work at once
      const message = this.newest;
      this.newest = null;
      this.send(message);
    }
    this.onMessage(head, (place) => floats.subarray(place[0], place[0] + place[1]));
  }

  // How long the oldest message has waited for its answer, in ms.
  get patience() {
    return this.waiting.size ? performance.now() - Math.min(...this.waiting.values()) : 0;
  }

  send(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return;
    this.number = (this.number % 0xffffffff) + 1;
    if (message.type !== "search" && message.type !== "stop") this.waiting.set(this.number, performance.now());
    this.socket.send(JSON.stringify({ ...message, id: this.number }));
  }

  sendNewest(message) {
    if (this.waiting.size) this.newest = message;
    else this.send(message);
  }
}
