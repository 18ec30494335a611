// Subscribes to a value of an OPC UA door twice, without a filter and with one, and prints each change as a line of JSON.
// Arguments: the URL, the node, and the filter as JSON; "refused" in place of changes names the status of a refusal.
const {
    OPCUAClient, MessageSecurityMode, SecurityPolicy, AttributeIds, TimestampsToReturn, UserTokenType,
    DataChangeFilter, ClientSubscription, MonitoredItemCreateRequest, CreateMonitoredItemsRequest, MonitoringMode,
    DataChangeTrigger, DeadbandType,
} = require("node-opcua");

const [url, user, password, nodeId, filterText] = process.argv.slice(2);
const wished = JSON.parse(filterText);
const say = (told) => console.log(JSON.stringify(told));

async function main() {
    const client = OPCUAClient.create({
        endpointMustExist: false, securityMode: MessageSecurityMode.None, securityPolicy: SecurityPolicy.None,
        connectionStrategy: { maxRetry: 0, initialDelay: 100 },
    });
    await client.connect(url);
    const session = await client.createSession({ type: UserTokenType.UserName, userName: user, password });
    const subscription = await session.createSubscription2({
        requestedPublishingInterval: 50, requestedLifetimeCount: 1000, requestedMaxKeepAliveCount: 20,
        publishingEnabled: true,
    });
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
    await session.close();
    await client.disconnect();
}

main().then(() => process.exit(0), (error) => {
    say({ refused: error.message.replace(/.*(Bad\w+).*/s, "$1") });
    process.exit(0);
});
