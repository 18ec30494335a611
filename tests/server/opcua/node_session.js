// A session of node-opcua with an OPC UA door, for the other programs in this folder.
const {
    OPCUAClient, MessageSecurityMode, SecurityPolicy, UserTokenType,
} = require("node-opcua");

const say = (told) => console.log(JSON.stringify(told));

// Run work(session), then end the process, with status 1 and an error text on failure. Without a user: anonymous.
function withSession(url, user, password, work, refused = (error) => { throw error; }) {
    const run = async () => {
        const client = OPCUAClient.create({
            endpointMustExist: false, securityMode: MessageSecurityMode.None, securityPolicy: SecurityPolicy.None,
            connectionStrategy: { maxRetry: 0, initialDelay: 100 },
        });
        await client.connect(url);
        let session;
        try {
            session = await client.createSession(
                user ? { type: UserTokenType.UserName, userName: user, password } : undefined);
        } catch (error) {
            await client.disconnect();
            return refused(error);
        }
        await work(session);
        await session.close();
        await client.disconnect();
    };
    run().then(() => process.exit(0), (error) => { console.error(error); process.exit(1); });
}

const subscribed = (session) => session.createSubscription2({
    requestedPublishingInterval: 50, requestedLifetimeCount: 1000, requestedMaxKeepAliveCount: 20,
    publishingEnabled: true,
});

module.exports = { say, subscribed, withSession };
