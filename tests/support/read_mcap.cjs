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
  let backInTime = 0;
  let last = 0n;
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const { topic } = reader.channelsById.get(message.channelId);
    counts[topic] = (counts[topic] ?? 0) + 1;
    backInTime += message.logTime < last ? 1 : 0;
    last = message.logTime;
  }
  const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  stream.append(bytes);
  let streamed = 0;
  for (let record = stream.nextRecord(); record; record = stream.nextRecord()) {
    streamed += record.type === "Message" ? 1 : 0;
  }
  console.log(JSON.stringify({ counts, streamed, back_in_time: backInTime, done: stream.done() }));
})();
