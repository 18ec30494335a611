// Subscribe to a value of an OPC UA door without and with a filter, and print each change as a line of JSON.
// Arguments: URL, node, and the filter as JSON. Prints the status as "refused" instead of changes if it is refused.
const { AttributeIds, TimestampsToReturn, DataChangeFilter, DataChangeTrigger, DeadbandType } = require("node-opcua");
const { say, subscribed, withSession } = require("./node_session.js");

const [url, user, password, nodeId, filterText] = process.argv.slice(2);
const wished = JSON.parse(filterText);

withSession(url, user, password, async (session) => {
    const subscription = await subscribed(session);
    const filter = new DataChangeFilter({
        trigger: DataChangeTrigger[wished.trigger], deadbandType: DeadbandType[wished.deadband.replace("_", "")], deadbandValue: wished.size,
    });
    const place = { nodeId, attributeId: AttributeIds.Value };
    for (const [name, parameters] of [["all", {}], ["filtered", { filter }]]) {
        const item = await subscription.monitor(
            place, { samplingInterval: 50, queueSize: 100, discardOldest: true, ...parameters }, TimestampsToReturn.Both);
        if (item.statusCode && !item.statusCode.isGood()) {
            say({ refused: item.statusCode.name });
            continue;
        }
        item.on("changed", (value) => say({
            item: name, value: value.value.value, status: value.statusCode.name, time: value.sourceTimestamp,
        }));
    }
    process.stdin.on("data", () => {});
    await new Promise((resolve) => process.stdin.on("end", resolve));
    await subscription.terminate();
});
