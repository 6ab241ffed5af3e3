// An OPC UA server with the stack node-opcua, driven by lines of JSON on stdin.
//   node opcua_server.js OPTIONS   prints {"port": ...} when it listens; OPTIONS is JSON:
//     port, loops (pairs OP/PV), array (length of the exchange array), user, password, sessions
// Nodes: ns=1;s=L<n>.OP, ns=1;s=L<n>.PV (Double), ns=1;s=Text (String), ns=1;s=Exchange (UInt16[]).
// Commands: {"step": k} sets every OP of loop n to k + n and PV to -(k + n), at one time;
//   {"set": name, "value": v, "status": code} one value; "NaN" stands for NaN
//   {"words": [[index, word], ...]} elements of the array
// Every command is answered with {"words": [...]}, the array as it is.
const opcua = require("node-opcua");
const fs = require("fs");
const os = require("os");
const path = require("path");
const readline = require("readline");

const options = JSON.parse(process.argv[2]);
const { DataType, StatusCodes, Variant, VariantArrayType } = opcua;

async function main() {
    const folder = options.pki ?? fs.mkdtempSync(path.join(os.tmpdir(), "opcua-pki-"));
    const certificates = new opcua.OPCUACertificateManager({
        rootFolder: folder, automaticallyAcceptUnknownCertificate: true,
    });
    await certificates.initialize();
    const server = new opcua.OPCUAServer({
        hostname: "127.0.0.1",
        port: options.port ?? 0,
        serverCertificateManager: certificates,
        userCertificateManager: certificates,
        certificateFile: options.certificateFile,
        privateKeyFile: options.privateKeyFile,
        disableDiscovery: true,
        // the standard's thousands of nodes are half of what a start takes
        nodeset_filename: [options.few_nodes ? opcua.get_mini_nodeset_filename() : opcua.nodesets.standard],
        allowAnonymous: !options.user,
        securityPolicies: [opcua.SecurityPolicy.None, opcua.SecurityPolicy.Basic256Sha256],
        userManager: {
            isValidUser: (user, password) => user === options.user && password === options.password,
        },
        serverCapabilities: { maxSessions: options.sessions ?? 50, operationLimits: { maxNodesPerRead: 1000 } },
    });
    await server.initialize();
    const space = server.engine.addressSpace;
    const own = space.getOwnNamespace();
    const variables = {};
    const add = (name, dataType, value) => {
        variables[name] = own.addVariable({
            organizedBy: space.rootFolder.objects, browseName: name, nodeId: `s=${name}`, dataType,
            minimumSamplingInterval: 10, value: { dataType, value },
        });
    };
    for (let n = 0; n < (options.loops ?? 1); n++) {
        add(`L${n}.OP`, "Double", n);
        add(`L${n}.PV`, "Double", -n);
    }
    add("Text", "String", "hello");
    const array = own.addVariable({
        organizedBy: space.rootFolder.objects, browseName: "Exchange", nodeId: "s=Exchange",
        dataType: "UInt16", valueRank: 1, accessLevel: "CurrentRead | CurrentWrite",
        value: {
            dataType: DataType.UInt16, arrayType: VariantArrayType.Array,
            value: new Uint16Array(options.array ?? 200),
        },
    });
    await server.start();
    const answer = (extra) => {
        const words = Array.from(array.readValue().value.value);
        console.log(JSON.stringify({ ...extra, words }));
    };
    answer({
        port: server.endpoints[0].port,
        namespace: own.namespaceUri,
        certificate: server.getCertificate().toString("base64"),
    });
    readline.createInterface({ input: process.stdin }).on("line", (line) => {
        const command = JSON.parse(line);
        if (command.step !== undefined) {
            for (let n = 0; n < (options.loops ?? 1); n++) {
                const value = command.step + n;
                variables[`L${n}.OP`].setValueFromSource({ dataType: "Double", value });
                variables[`L${n}.PV`].setValueFromSource({ dataType: "Double", value: -value });
            }
        }
        if (command.set !== undefined) {
            const value = command.value === "NaN" ? NaN : command.value;
            const status = StatusCodes[command.status ?? "Good"];
            const dataType = typeof value === "string" ? "String" : "Double";
            variables[command.set].setValueFromSource({ dataType, value }, status);
        }
        if (command.words !== undefined) {
            const now = Uint16Array.from(array.readValue().value.value);
            for (const [index, word] of command.words) now[index] = word;
            array.setValueFromSource(new Variant({
                dataType: DataType.UInt16, arrayType: VariantArrayType.Array, value: now,
            }));
        }
        answer({});
    });
}

main().catch((error) => { console.error(error); process.exit(1); });
