// Follow the alarms of an OPC UA door with node-opcua's alarm client, and carry out commands from standard input.
// Arguments: URL, user, password. A command is one line: {"do": "acknowledge" | "confirm" | "comment", "condition",
// "event" (hexadecimal, the latest if missing), "comment"}, or {"do": "browse", "node"}. The program prints each change
// of an alarm, each other event, and the result of each command.
const readline = require("readline");
const { AttributeIds, TimestampsToReturn, constructEventFilter, installAlarmMonitoring } = require("node-opcua");
const { say, subscribed, withSession } = require("./node_session.js");

const [url, user, password] = process.argv.slice(2);
const of = (variant) => (variant ? variant.value : null);

withSession(url, user, password, async (session) => {
    const alarms = await installAlarmMonitoring(session);
    const events = new Map();
    const tell = (alarm) => {
        const fields = alarm.fields;
        const condition = alarm.conditionId.toString();
        events.set(condition, alarm.eventId);
        say({
            alarm: condition, event: alarm.eventId.toString("hex"), type: alarm.eventType.toString(),
            retain: alarm.getRetain(), active: of(fields.activeState.id), acked: of(fields.ackedState.id),
            confirmed: of(fields.confirmedState.id), severity: of(fields.severity),
            message: of(fields.message).text, comment: of(fields.comment).text, user: of(fields.clientUserId),
            branch: of(fields.branchId) ? of(fields.branchId).toString() : null,
            quality: of(fields.quality) ? of(fields.quality).name : null, name: of(fields.conditionName),
            enabled: of(fields.enabledState.id), source: of(fields.sourceName),
        });
    };
    alarms.alarms().forEach(tell);
    alarms.on("alarmChanged", tell);
    const subscription = await subscribed(session);
    const refreshed = await subscription.monitor(
        { nodeId: "i=2253", attributeId: AttributeIds.EventNotifier },
        { samplingInterval: 0, queueSize: 100, discardOldest: true, filter: constructEventFilter(["EventType"]) },
        TimestampsToReturn.Both);
    refreshed.on("changed", (fields) => say({ told: fields[0].value.toString() }));
    say({ ready: true });
    for await (const line of readline.createInterface({ input: process.stdin })) {
        const asked = JSON.parse(line);
        if (asked.do === "browse") {
            const found = await session.browse({ nodeId: asked.node, resultMask: 63, includeSubtypes: true });
            say({ browsed: found.references.map((each) => [each.referenceTypeId.toString(), each.nodeId.toString()]) });
            continue;
        }
        const event = asked.event ? Buffer.from(asked.event, "hex") : events.get(asked.condition);
        const act = { acknowledge: "acknowledgeCondition", confirm: "confirmCondition", comment: "addCommentCondition" };
        const status = await session[act[asked.do]](asked.condition, event, asked.comment || "");
        say({ done: asked.do, status: status.name });
    }
    await subscription.terminate();
});
