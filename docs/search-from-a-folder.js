// Browsers give a page from a folder no Worker: what the search wants of one, done in a hidden frame.
if (location.protocol === "file:") {
  const load = (frame, url) => new Promise((loaded, failed) => {
    const script = frame.document.createElement("script")
    Object.assign(script, { src: url, onload: loaded, onerror: failed })
    frame.document.body.appendChild(script)
  })
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.element = document.body.appendChild(Object.assign(document.createElement("iframe"), { hidden: true }))
      const frame = this.frame = this.element.contentWindow
      frame.document.open()
      frame.document.write("<html><body></body></html>")
      frame.document.close()
      frame.postMessage = data => this.dispatchEvent(new MessageEvent("message", { data }))
      frame.importScripts = (...urls) => urls.reduce((done, one) => done.then(() => load(frame, one)), Promise.resolve())
      this.ready = load(frame, new URL(url, location.href).href)
    }
    postMessage(data) {
      this.ready.then(() => this.frame.dispatchEvent(new MessageEvent("message", { data })))
    }
    terminate() { this.element.remove() }
  }
}
