// A Modbus server with the stack modbus-serial.
//   node server.js tcp            prints its port
//   node server.js rtu PORT UNIT  prints "ready"
// Holding register n holds n unless written, input register n holds 1000 + n, coil and discrete
// input n hold whether n is odd. Registers from 500 on do not exist.
const { ServerTCP, ServerSerial } = require("modbus-serial");
const net = require("net");

const written = new Map();
const exists = (address) => {
    if (address >= 500) {
        const error = new Error("no such register");
        error.modbusErrorCode = 2;
        throw error;
    }
};
const vector = {
    getHoldingRegister: (address) => (exists(address), written.get(address) ?? address),
    getInputRegister: (address) => (exists(address), 1000 + address),
    getCoil: (address) => (exists(address), address % 2 === 1),
    getDiscreteInput: (address) => (exists(address), address % 2 === 1),
    setRegister: (address, value) => (exists(address), void written.set(address, value)),
    setCoil: (address) => exists(address),
};

const [kind, port, unit] = process.argv.slice(2);
if (kind === "tcp") {
    const probe = net.createServer().listen(0, "127.0.0.1", () => {
        const free = probe.address().port;
        probe.close(() => {
            const server = new ServerTCP(vector, { host: "127.0.0.1", port: free, unitID: 1 });
            server.on("initialized", () => console.log(free));
            server.on("socketError", () => {});
        });
    });
} else {
    const options = { path: port, baudRate: 19200, unitID: Number(unit) };
    const server = new ServerSerial(vector, { ...options, openCallback: () => console.log("ready") });
    server.on("error", (error) => { console.error(error.message); process.exit(1); });
}
