// An OPC UA client with the stack node-opcua: looks at fieldlink's server and tries to change it.
//   node opcua_client.js OPTIONS   OPTIONS is JSON: endpoint, namespace (of the nodes), nodes (ids)
// Prints JSON: what it browsed below Objects, the values it read, one reported value, and the
// status of each attempt to write, call, add and delete.
const opcua = require("node-opcua");

const options = JSON.parse(process.argv[2]);
const { AttributeIds, DataType, NodeClass } = opcua;

async function browseBelow(session, nodeId, depth) {
    const found = {};
    const result = await session.browse({ nodeId, browseDirection: "Forward",
        referenceTypeId: "HierarchicalReferences", includeSubtypes: true, resultMask: 63 });
    for (const reference of result.references) {
        if (reference.nodeId.namespace === 0) continue;
        const below = depth > 1 && reference.nodeClass === NodeClass.Object
            ? await browseBelow(session, reference.nodeId, depth - 1) : {};
        found[reference.browseName.toString()] = below;
    }
    return found;
}

async function attempt(request, statusOf) {
    try {
        return statusOf(await request()).name;
    } catch (error) {
        return (/\b(Bad\w+)/.exec(error.message) ?? [error.message])[0];
    }
}

async function main() {
    const client = opcua.OPCUAClient.create({
        endpointMustExist: false, connectionStrategy: { maxRetry: 1 }, requestedSessionTimeout: 60000,
    });
    await client.connect(options.endpoint);
    const session = await client.createSession();
    const namespaces = await session.readNamespaceArray();
    const tree = await browseBelow(session, "ObjectsFolder", 3);
    const values = {};
    for (const id of options.nodes) {
        const nodeId = `ns=1;s=${id}`;
        const data = await session.read({ nodeId, attributeId: AttributeIds.Value });
        const type = await session.getBuiltInDataType(nodeId);
        values[id] = { value: data.value.value, status: data.statusCode.name, type: DataType[type],
            time: data.sourceTimestamp };
    }
    const strings = await session.read({
        nodeId: `ns=${namespaces.indexOf("http://opcfoundation.org/UA/DI/")};i=6450`,
        attributeId: AttributeIds.Value,
    });
    const subscription = await session.createSubscription2({ requestedPublishingInterval: 50,
        requestedLifetimeCount: 100, requestedMaxKeepAliveCount: 10, publishingEnabled: true });
    const item = await subscription.monitor(
        { nodeId: `ns=1;s=${options.nodes[0]}`, attributeId: AttributeIds.Value },
        { samplingInterval: 50, queueSize: 1 }, opcua.TimestampsToReturn.Both);
    const reported = await new Promise((done) => item.on("changed", (data) => done(data.value.value)));
    await subscription.terminate();

    const target = `ns=1;s=${options.nodes[0]}`;
    const refused = {
        write: await attempt(() => session.write({ nodeId: target, attributeId: AttributeIds.Value,
            value: { value: { dataType: "Double", value: 99 } } }), (status) => status),
        describe: await attempt(() => session.write({ nodeId: target,
            attributeId: AttributeIds.Description,
            value: { value: { dataType: "LocalizedText", value: { text: "x" } } } }), (status) => status),
        call: await attempt(() => session.call({ objectId: "i=2253", methodId: "i=11492",
            inputArguments: [{ dataType: "UInt32", value: 1 }] }), (result) => result.statusCode),
        add: await attempt(() => session.performMessageTransaction(new opcua.AddNodesRequest({
            nodesToAdd: [{ parentNodeId: "ns=0;i=85", referenceTypeId: "i=35",
                requestedNewNodeId: "ns=1;s=mine", browseName: "mine", nodeClass: NodeClass.Object,
                typeDefinition: "i=58" }] })), (result) => result.results[0].statusCode),
        delete: await attempt(() => session.performMessageTransaction(new opcua.DeleteNodesRequest({
            nodesToDelete: [{ nodeId: "ns=1;s=Loops", deleteTargetReferences: true }] })),
        (result) => result.results[0]),
    };
    await session.close();
    await client.disconnect();
    console.log(JSON.stringify({ namespaces, tree, values, reported, refused,
        health: strings.value.value.map((text) => text.text) }));
}

main().then(() => process.exit(0), (error) => { console.error(error); process.exit(1); });
