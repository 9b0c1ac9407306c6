// What the official TypeScript reader (@mcap/core, which Foxglove reads logs with) finds in a log, as JSON.
// Usage: node read.mjs FILE TOPIC. The messages of TOPIC, which are protobuf, are decoded.
import { createHash } from "node:crypto";
import { open, readFile } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers, protobufFromBinaryDescriptor } from "@mcap/support";

const [path, decoded] = process.argv.slice(2);
const decompressHandlers = await loadDecompressHandlers();

// By the index: topics, and a digest of the log times and payloads of each in the order of their times.
const file = await open(path);
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(file),
  decompressHandlers,
});
const topics = {};
const rows = [];
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  const found = (topics[channel.topic] ??= {
    schema: schema?.name ?? "",
    encoding: channel.messageEncoding,
    messages: 0,
    digest: createHash("sha256"),
  });
  found.messages += 1;
  found.digest.update(`${message.logTime} ${message.data.byteLength} `).update(message.data);
  if (channel.topic === decoded) {
    const type = protobufFromBinaryDescriptor(schema.data).lookupType(schema.name);
    rows.push(type.toObject(type.decode(message.data), { longs: String, arrays: false }));
  }
}
for (const found of Object.values(topics)) {
  found.digest = found.digest.digest("hex");
}

// From the beginning to the end, every CRC checked, as a file that is still being sent is read.
const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
stream.append(await readFile(path));
const records = {};
for (let record; (record = stream.nextRecord()) != undefined; ) {
  records[record.type] = (records[record.type] ?? 0) + 1;
}

console.log(
  JSON.stringify({
    profile: reader.header.profile,
    metadata: reader.metadataIndexes.map((index) => index.name),
    topics,
    rows,
    messages_in_stream: records.Message,
    is_whole: stream.done(),
  }),
);
await file.close();
