// SPDX-License-Identifier: Apache-2.0
// The three things of a browser that three.js's loaders use and node 18 lacks:
// `self`, ProgressEvent, and Worker on a blob: URL.
import { resolveObjectURL } from 'node:buffer';
import { Worker as NodeWorker } from 'node:worker_threads';

globalThis.self = globalThis;

globalThis.ProgressEvent ??= class ProgressEvent extends Event {
  constructor(type, { lengthComputable = false, loaded = 0, total = 0 } = {}) {
    super(type);
    Object.assign(this, { lengthComputable, loaded, total });
  }
};

// Runs before a worker's script: its global scope as a browser would give it.
const kWorkerPrelude = `
const { parentPort } = require('node:worker_threads');
globalThis.self = globalThis;
self.postMessage = (message, transfer) => parentPort.postMessage(message, transfer);
parentPort.on('message', (data) => self.onmessage({ data }));
`;

globalThis.Worker = class Worker {
  onmessage = null;
  onerror = null;

  constructor(url) {
    // The blob's text comes later; messages sent before that wait in order.
    this.started = resolveObjectURL(url).text().then((script) => {
      const worker = new NodeWorker(kWorkerPrelude + script, { eval: true });
      worker.on('message', (data) => this.onmessage?.({ data }));
      worker.on('error', (error) => {
        console.error('worker:', error.message);
        this.onerror?.(error);
      });
      worker.unref();
      return worker;
    });
  }

  postMessage(message, transfer) {
    this.started.then((worker) => worker.postMessage(message, transfer));
  }

  terminate() {
    this.started.then((worker) => worker.terminate());
  }
};
