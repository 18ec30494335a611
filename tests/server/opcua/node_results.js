// Request several nodes of an OPC UA door together, one of them unknown. Print the statuses of each service as a line
// of JSON, then the values of further nodes.
// Arguments: URL, user, password, a variable with a history, an unknown node, and further nodes.
const {
    AttributeIds, CreateMonitoredItemsRequest, DataType, HistoryReadRequest, ReadRawModifiedDetails, TimestampsToReturn,
} = require("node-opcua");
const { say, subscribed, withSession } = require("./node_session.js");

const [url, user, password, good, bad, ...further] = process.argv.slice(2);
const nodes = [good, bad, good];
const names = (results) => results.map((each) => (each.statusCode || each).name);

withSession(url, user, password, async (session) => {
    const told = {};
    told.read = names(await session.read(nodes.map((nodeId) => ({ nodeId, attributeId: AttributeIds.Value }))));
    told.write = names(await session.write(nodes.map((nodeId) => ({
        nodeId, attributeId: AttributeIds.Value, value: { value: { dataType: DataType.Double, value: 1 } },
    }))));
    const subscription = await subscribed(session);
    const created = await session.createMonitoredItems(new CreateMonitoredItemsRequest({
        subscriptionId: subscription.subscriptionId, timestampsToReturn: TimestampsToReturn.Both,
        itemsToCreate: nodes.map((nodeId, place) => ({
            itemToMonitor: { nodeId, attributeId: AttributeIds.Value },
            requestedParameters: { clientHandle: place + 1, samplingInterval: 50, queueSize: 1 },
        })),
    }));
    told.monitor = names(created.results);
    const past = await session.historyRead(new HistoryReadRequest({
        historyReadDetails: new ReadRawModifiedDetails({
            isReadModified: false, startTime: new Date(Date.now() - 60000), endTime: new Date(), numValuesPerNode: 3,
        }),
        nodesToRead: nodes.map((nodeId) => ({ nodeId })), timestampsToReturn: TimestampsToReturn.Both,
    }));
    told.history = names(past.results);
    const plain = (value) => (Array.isArray(value) ? value.map(plain) : value && value.text !== undefined ? value.text : value);
    told.values = [];
    for (const nodeId of further) {
        const found = await session.read({ nodeId, attributeId: AttributeIds.Value });
        told.values.push(plain(found.value ? found.value.value : null));
    }
    say(told);
});
