// Reads a file with @mcap/core, check sums included, by its index and as a stream; prints what it found as JSON.
const { readFileSync } = require("node:fs");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");

(async () => {
  const bytes = readFileSync(process.argv[2]);
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) => bytes.subarray(Number(offset), Number(offset) + Number(length)),
  };
  const decompressHandlers = await loadDecompressHandlers();
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const counts = {};
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const { topic } = reader.channelsById.get(message.channelId);
    counts[topic] = (counts[topic] ?? 0) + 1;
  }
  const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  stream.append(bytes);
  let streamed = 0;
  let backInTime = 0;
  let last = 0n;
  for (let record = stream.nextRecord(); record; record = stream.nextRecord()) {
    if (record.type === "Message") {
      streamed += 1;
      backInTime += record.logTime < last ? 1 : 0;
      last = record.logTime;
    }
  }
  console.log(JSON.stringify({ counts, streamed, back_in_time: backInTime, done: stream.done() }));
})();
