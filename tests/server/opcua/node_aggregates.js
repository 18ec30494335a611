// Read aggregates over the history of a value of an OPC UA door, and print them as one line of JSON.
// Arguments: URL, user, password, node, begin and end, interval in ms, names of aggregates.
const { AggregateFunction, AttributeIds } = require("node-opcua");
const { say, withSession } = require("./node_session.js");

const [url, user, password, nodeId, begin, end, interval, ...names] = process.argv.slice(2);

withSession(url, user, password, async (session) => {
    const told = {};
    for (const name of names) {
        const found = await session.readAggregateValue(
            { nodeId, attributeId: AttributeIds.Value }, new Date(begin), new Date(end), AggregateFunction[name],
            Number(interval));
        told[name] = found.historyData ? found.historyData.dataValues.map((each) => each.value ? each.value.value : null)
            : found.statusCode.name;
    }
    const offered = await session.browse("i=11201");
    told.offered = offered.references.map((each) => each.browseName.name);
    say(told);
});
