/* Search without a server: browsers start no worker for a page opened from a disk, so its script runs in a hidden frame. */
if (location.protocol === "file:") {
  window.IFrameWorker = class extends EventTarget {
    constructor(address) {
      super();
      const frame = document.createElement("iframe");
      const waiting = [];
      let inside = null;
      this.postMessage = (data) => {
        if (inside) inside.dispatchEvent(new MessageEvent("message", { data }));
        else waiting.push(data);
      };
      this.terminate = () => frame.remove();
      frame.hidden = true;
      document.body.append(frame);
      const room = frame.contentWindow;
      room.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      room.importScripts = (...addresses) =>
        addresses.reduce((before, next) => before.then(() => run(room.document, next)), Promise.resolve());
      run(room.document, address).then(() => {
        inside = room;
        waiting.splice(0).forEach((data) => this.postMessage(data));
      });
    }
  };
  const run = (page, address) =>
    new Promise((done, failed) => {
      const script = page.createElement("script");
      script.src = new URL(address, location.href).href;
      script.onload = done;
      script.onerror = () => failed(new Error(`${address} cannot be loaded`));
      page.body.append(script);
    });
  window.Worker = window.IFrameWorker;
}
