// Read from an OPC UA door the data that test_opcua_node_client.py checks, and print them as one line of JSON.
const { AttributeIds, DataType, TimestampsToReturn, constructEventFilter } = require("node-opcua");
const { say, subscribed, withSession } = require("./node_session.js");

const [url, user, password] = process.argv.slice(2);
const id = (text) => `ns=2;s=${text}`;
const pump = id("drives/pump");

withSession(url, user, password, async (session) => {
    const told = {};
    const names = async (node) =>
        (await session.browse(node)).references.map((each) => each.browseName.name);
    told.drives = await names(id("drives"));
    told.pump = await names(pump);

    const where = id("drives/pump/Monitoring/ConverterOutputFrequency");
    const read = await session.read({ nodeId: where, attributeId: AttributeIds.Value });
    told.value = {
        status: read.statusCode.name, number: typeof read.value.value === "number",
        source: Math.abs(Date.now() - read.sourceTimestamp.getTime()) < 60000,
    };
    told.unit = (await session.read({ nodeId: where + "/EngineeringUnits" })).value.value.unitId;

    const call = async (method, args = [], on = pump) => {
        const found = await session.call({ objectId: on, methodId: id("methods/" + method), inputArguments: args });
        return { found, told: { status: found.statusCode.name, outcome: found.outputArguments[0].value } };
    };

    const subscription = await subscribed(session);
    let running = false;
    const item = await subscription.monitor(
        { nodeId: id("drives/pump/Status/Running"), attributeId: AttributeIds.Value },
        { samplingInterval: 50, queueSize: 10, discardOldest: true }, TimestampsToReturn.Both);
    item.on("changed", (value) => { running = running || value.value.value === true; });
    told.events = 0;
    const heard = await subscription.monitor(
        { nodeId: "i=2253", attributeId: AttributeIds.EventNotifier },
        { samplingInterval: 0, queueSize: 100, discardOldest: true,
          filter: constructEventFilter(["EventId", "Message", "Severity", "SourceName"]) },
        TimestampsToReturn.Both);
    heard.on("changed", () => { told.events += 1; });

    told.unlocked = (await call("Start")).told;
    const context = [{ dataType: DataType.String, value: "a test" }];
    told.locked = (await call("InitLock", context, pump + "/Lock")).found.outputArguments[0].value;
    await call("SetReference", [
        { dataType: DataType.Double, value: 50 }, { dataType: DataType.String, value: "%" }]);
    told.started = (await call("Start")).told;
    for (let turn = 0; turn < 100 && !running; turn++) {
        await new Promise((resolve) => setTimeout(resolve, 50));
    }
    told.ran = running;
    told.stopped = (await call("Stop")).told;
    const begin = new Date(Date.now() - 60000);
    const past = await session.readHistoryValue(where, begin, new Date());
    told.history = past.historyData.dataValues.length;
    told.written = (await session.write({
        nodeId: id("drives/pump/Status/State"), attributeId: AttributeIds.Value,
        value: { value: { dataType: DataType.String, value: "x" } },
    }).catch((error) => ({ name: error.message.replace(/.*(Bad\w+).*/s, "$1") }))).name;
    for (let turn = 0; turn < 100 && !told.events; turn++) {
        await new Promise((resolve) => setTimeout(resolve, 50));
    }
    await subscription.terminate();
    say(told);
}, (error) => say({ refused: error.message }));
