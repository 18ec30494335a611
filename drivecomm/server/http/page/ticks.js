// A worker that counts time: browsers slow down the clocks of pages that are not seen, but not those of workers.
setInterval(() => postMessage(null), 500);
