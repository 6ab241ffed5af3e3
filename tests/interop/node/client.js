// A Modbus client with the stack modbus-serial: reads, writes, reads back; prints JSON.
//   node client.js tcp PORT | rtu-tcp PORT | rtu DEVICE
const ModbusRTU = require("modbus-serial");

const [kind, where] = process.argv.slice(2);
const client = new ModbusRTU();
const connect = {
    tcp: () => client.connectTCP("127.0.0.1", { port: Number(where) }),
    "rtu-tcp": () => client.connectTelnet("127.0.0.1", { port: Number(where) }),
    rtu: () => client.connectRTUBuffered(where, { baudRate: 19200 }),
}[kind];

(async () => {
    await connect();
    client.setID(1);
    client.setTimeout(5000);
    const before = (await client.readHoldingRegisters(10, 2)).data;
    const input = (await client.readInputRegisters(5, 1)).data;
    const coil = (await client.readCoils(19, 1)).data[0];
    await client.writeRegisters(10, [0x4248, 7]);
    await client.writeRegister(11, 9);
    await client.writeCoil(19, true);
    const after = (await client.readHoldingRegisters(10, 2)).data;
    let refused = "";
    try { await client.readHoldingRegisters(400, 1); } catch (error) { refused = error.modbusCode; }
    console.log(JSON.stringify({ before, input, coil, after, refused }));
    client.close(() => process.exit(0));
})().catch((error) => { console.error(error.message); process.exit(1); });
