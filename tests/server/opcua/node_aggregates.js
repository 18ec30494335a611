// Reads aggregates over the history of a value of an OPC UA door, and prints them as one line of JSON.
// Arguments: the URL, a user and the password, the node, from when and to when, the interval in ms, names of aggregates.
const {
    OPCUAClient, MessageSecurityMode, SecurityPolicy, UserTokenType, AggregateFunction, AttributeIds,
} = require("node-opcua");

const [url, user, password, nodeId, begin, end, interval, ...names] = process.argv.slice(2);

async function main() {
    const client = OPCUAClient.create({
        endpointMustExist: false, securityMode: MessageSecurityMode.None, securityPolicy: SecurityPolicy.None,
        connectionStrategy: { maxRetry: 0, initialDelay: 100 },
    });
    await client.connect(url);
    const session = await client.createSession({ type: UserTokenType.UserName, userName: user, password });
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
    await session.close();
    await client.disconnect();
    return told;
}

main().then((told) => { console.log(JSON.stringify(told)); process.exit(0); },
            (error) => { console.error(error); process.exit(1); });
