// Reads recordings with @mcap/core, every record and checksum of it, and tells what is in them.
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";

const require = createRequire(process.argv[2] + "/");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { decompress } = require("fzstd");
const decompressHandlers = { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) };

for (const path of process.argv.slice(3)) {
  const bytes = new Uint8Array(readFileSync(path));
  const told = { messages: 0, indexed: 0, metadata: {}, attachments: {}, topics: {}, isDone: false };
  const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  stream.append(bytes);
  const topics = new Map();
  for (let record; (record = stream.nextRecord()); ) {
    if (record.type === "Channel") topics.set(record.id, record.topic);
    if (record.type === "Metadata") told.metadata[record.name] = Object.fromEntries(record.metadata);
    if (record.type === "Attachment") told.attachments[record.name] = record.data.byteLength;
    if (record.type !== "Message") continue;
    told.messages += 1;
    const topic = topics.get(record.channelId);
    told.topics[topic] = (told.topics[topic] ?? 0) + 1;
  }
  told.isDone = stream.done();
  if (told.isDone) {
    const readable = {
      size: async () => BigInt(bytes.length),
      read: async (at, size) => bytes.subarray(Number(at), Number(at + size)),
    };
    const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
    let last = 0n;
    for await (const message of reader.readMessages()) {
      if (message.logTime < last) throw new Error("messages are out of order");
      last = message.logTime;
      told.indexed += 1;
    }
    told.statistics = Number(reader.statistics.messageCount);
  }
  console.log(JSON.stringify(told));
}
