-- PROFIBUS DP-V0 telegrams and the SCH108BEX encoder for Wireshark and tshark.
--
-- tshark -X lua_script:profibus_dp.lua -r FILE.pcapng
-- or copy it to the folder that Help > About > Folders calls "Personal Lua Plugins".
--
-- It takes link type 147 (USER0), and 257 (PROFIBUS_DL) where Wireshark opens that. Field names are those of
-- `sch108bex decode`, in small letters, with profibus_dp. before them. Octets count from 1, as in the manual.

local proto = Proto("profibus_dp", "PROFIBUS DP")

local AUTO, ENCODER, STANDARD = 0, 1, 2
proto.prefs.profile = Pref.enum("Device data", AUTO,
    "Whose parameters, data and diagnoses are read beyond the standard's part",
    { { 1, "an encoder's, where they can be nothing else", AUTO }, { 2, "every slave is an encoder", ENCODER },
      { 3, "the standard only", STANDARD } }, false)

-- Names -------------------------------------------------------------------------------------------

local FORMATS = { [0x10] = "SD1", [0x68] = "SD2", [0xA2] = "SD3", [0xDC] = "SD4 (token)", [0xE5] = "SC (short acknowledgement)" }
local FUNCTIONS = { [0] = "time event", [3] = "SDA low", [4] = "SDN low", [5] = "SDA high", [6] = "SDN high",
    [7] = "MSRD", [9] = "FDL status", [12] = "SRD low", [13] = "SRD high", [14] = "Ident", [15] = "LSAP status" }
local RESPONSES = { [0] = "OK", [1] = "UE: user error", [2] = "RR: no resource for the data",
    [3] = "RS: no service activated here", [8] = "DL: data", [9] = "NR: no data", [10] = "DH: data, a diagnosis waits",
    [12] = "RDL", [13] = "RDH" }
local STATION_TYPES = { [0] = "slave", [1] = "master, not ready", [2] = "master, ready for the ring", [3] = "master in the ring" }
local SERVICES = { [55] = "Set_Slave_Add", [56] = "RD_Inp", [57] = "RD_Outp", [58] = "Global_Control", [59] = "Get_Cfg",
    [60] = "Slave_Diag", [61] = "Set_Prm", [62] = "Chk_Cfg" }
local SAPS = { [48] = "DP-V1", [49] = "DP-V1", [50] = "DP-V1 alarms", [51] = "DP-V1", [53] = "Set_Ext_Prm", [54] = "master to master",
    [63] = "all SAPs" }
for sap, name in pairs(SERVICES) do SAPS[sap] = name end
SAPS[62] = "Chk_Cfg, or the master's own"
local TIME_BASES = { [0] = "steps per 10 ms", [1] = "steps per 100 ms", [2] = "steps per 1000 ms", [3] = "revolutions per minute" }
local ENCODER_TYPES = { [0] = "singleturn absolute", [1] = "multiturn absolute", [2] = "singleturn absolute with electronic turn count",
    [3] = "incremental", [4] = "incremental with battery", [5] = "linear incremental", [6] = "linear incremental",
    [7] = "linear absolute", [8] = "linear absolute" }
local ALARMS = { { 0, "position error" }, { 1, "supply voltage" }, { 2, "current too high" },
    { 3, "commissioning diagnostics" }, { 4, "memory error" } }
local WARNINGS = { { 0, "frequency exceeded" }, { 1, "temperature exceeded" }, { 2, "light control reserve used up" },
    { 3, "CPU watchdog" }, { 4, "operating time limit exceeded" }, { 5, "battery low" }, { 6, "reference point not reached" } }

-- Fields ------------------------------------------------------------------------------------------

local f = {}
local function name_of(key) return "profibus_dp." .. key:lower() end
local function u8(key, words, mask) f[key] = ProtoField.uint8(name_of(key), key, base.DEC, words, mask) end
local function u16(key, form) f[key] = ProtoField.uint16(name_of(key), key, form or base.DEC) end
local function u32(key, mask) f[key] = ProtoField.uint32(name_of(key), key, base.DEC, nil, mask) end
local function i32(key) f[key] = ProtoField.int32(name_of(key), key, base.DEC) end
local function bytes(key) f[key] = ProtoField.bytes(name_of(key), key) end
local function text(key) f[key] = ProtoField.string(name_of(key), key) end
local function bit(key, number, words)
    f[key] = ProtoField.bool(name_of(key), key, 8, words, 2 ^ number)
end

f.format = ProtoField.uint8("profibus_dp.format", "Format", base.HEX, FORMATS)
u8("LE")
u8("DA", nil, 0x7F)
u8("SA", nil, 0x7F)
f.FC = ProtoField.uint8("profibus_dp.fc", "FC", base.HEX)
bit("Request", 6, { "request", "response" })
bit("FCB", 5)
bit("FCV", 4, { "FCB counts", "FCB does not count" })
u8("Function", FUNCTIONS, 0x0F)
u8("Response_Code", RESPONSES, 0x0F)
u8("Station_Type", STATION_TYPES, 0x30)
u8("DSAP", SAPS)
u8("SSAP", SAPS)
f.FCS = ProtoField.uint8("profibus_dp.fcs", "FCS", base.HEX)
f.ED = ProtoField.uint8("profibus_dp.ed", "ED", base.HEX)
text("Service")
text("Direction")
f.Retry = ProtoField.bool("profibus_dp.retry", "Retry")
f.response_in = ProtoField.framenum("profibus_dp.response_in", "Answer in", base.NONE, frametype.RESPONSE)
f.response_to = ProtoField.framenum("profibus_dp.response_to", "Answer to", base.NONE, frametype.REQUEST)
f.response_time = ProtoField.relative_time("profibus_dp.response_time", "Time since the request")
bytes("Data")
bytes("rest")
bytes("Inputs")
bytes("Outputs")

-- Set_Prm
bit("Lock_Req", 7); bit("Unlock_Req", 6); bit("Sync_Req", 5); bit("Freeze_Req", 4); bit("WD_On", 3)
u8("WD_Fact_1"); u8("WD_Fact_2"); u8("min_Tsdr"); u16("Ident_Number", base.HEX)
f.Group_Ident = ProtoField.uint8("profibus_dp.group_ident", "Group_Ident", base.HEX)
bit("DPV1_Enable", 7); bit("Fail_Safe", 6); bit("Publisher_Enable", 5)
bit("WD_Base", 2, { "1 ms", "10 ms" }); bit("Dis_Stop_Control", 1); bit("Dis_Start_Control", 0)
bytes("User_Prm_Data")
bytes("Identifier")
-- Slave_Diag
local DIAGNOSIS = { { 1, "Master_Lock", 7 }, { 1, "Prm_Fault", 6 }, { 1, "Invalid_Slave_Response", 5 }, { 1, "Not_Supported", 4 },
    { 1, "Ext_Diag", 3 }, { 1, "Cfg_Fault", 2 }, { 1, "Station_Not_Ready", 1 }, { 1, "Station_Non_Existent", 0 },
    { 2, "Deactivated", 7 }, { 2, "Sync_Mode", 5 }, { 2, "Freeze_Mode", 4 }, { 2, "WD_On", 3 }, { 2, "Stat_Diag", 1 },
    { 2, "Prm_Req", 0 }, { 3, "Ext_Diag_Overflow", 7 } }
for _, row in ipairs(DIAGNOSIS) do
    if not f[row[2]] then bit(row[2], row[3]) end
end
u8("Master_Add", { [255] = "no owner" })
bytes("Device_Block"); bytes("Identifier_Block"); bytes("Channel_Block"); u8("Diag_Revision", nil, 0x3F)
-- Global_Control, Set_Slave_Add
bit("Clear_Data", 1); bit("Unfreeze", 2); bit("Freeze", 3); bit("Unsync", 4); bit("Sync", 5)
f.Group_Select = ProtoField.uint8("profibus_dp.group_select", "Group_Select", base.HEX)
u8("New_Slave_Add"); u8("No_Add_Chg"); bytes("Rem_Slave_Data")
-- The encoder
bit("encoder.code_sequence", 0, { "increasing counter-clockwise", "increasing clockwise" })
bit("encoder.class_2", 1, { "class 2 functionality", "class 1" })
bit("encoder.commissioning_diagnostics", 2)
bit("encoder.scaling", 3, { "on", "off" })
u32("encoder.measuring_units_per_revolution"); u32("encoder.total_measuring_range")
bytes("encoder.reserved"); u8("encoder.time_base", TIME_BASES)
bit("encoder.preset", 7); u32("encoder.preset_value", 0x7FFFFFFF)
u32("encoder.position"); i32("encoder.velocity"); i32("encoder.acceleration")
u8("encoder.header"); f["encoder.alarms"] = ProtoField.uint8("profibus_dp.encoder.alarms", "encoder.alarms", base.HEX)
u16("encoder.warnings", base.HEX); u8("encoder.type", ENCODER_TYPES); u32("encoder.singleturn_resolution")
u16("encoder.revolutions"); u8("encoder.additional_alarms"); u16("encoder.supported_alarms", base.HEX)
u16("encoder.supported_warnings", base.HEX); u16("encoder.profile_version", base.HEX)
u16("encoder.software_version", base.HEX); u32("encoder.operating_time"); i32("encoder.offset")
i32("encoder.manufacturer_offset"); text("encoder.serial_number")
text("state")

local all = {}
for _, field in pairs(f) do all[#all + 1] = field end
proto.fields = all

local function expert_of(key, words, group, severity) return ProtoExpert.new("profibus_dp.expert." .. key, words, group, severity) end
local e = {
    fcs = expert_of("fcs", "The check sum is wrong", expert.group.CHECKSUM, expert.severity.ERROR),
    ed = expert_of("ed", "A telegram ends with 16h", expert.group.MALFORMED, expert.severity.ERROR),
    le = expert_of("le", "The length cannot be", expert.group.MALFORMED, expert.severity.ERROR),
    sd = expert_of("sd", "No start delimiter", expert.group.MALFORMED, expert.severity.ERROR),
    short = expert_of("short", "It ends before its end", expert.group.MALFORMED, expert.severity.ERROR),
    sap = expert_of("sap", "Bit 7 of an address announces a SAP, and there is none", expert.group.MALFORMED, expert.severity.ERROR),
    retry = expert_of("retry", "The same request once more, by its frame count bit", expert.group.SEQUENCE, expert.severity.NOTE),
    alone = expert_of("alone", "The request that it answers is not here", expert.group.SEQUENCE, expert.severity.NOTE),
    refused = expert_of("refused", "Refused", expert.group.RESPONSE_CODE, expert.severity.WARN),
    diag = expert_of("diag", "The slave refuses or reports a fault", expert.group.RESPONSE_CODE, expert.severity.WARN),
    data = expert_of("data", "The data cannot be", expert.group.PROTOCOL, expert.severity.WARN),
}
local all_experts = {}
for _, one in pairs(e) do all_experts[#all_experts + 1] = one end
proto.experts = all_experts

-- What is known from telegrams before, and what each packet had of it -------------------------------

local stations, pending, memory

function proto.init()
    stations, pending, memory = {}, nil, {}
end

local function station(address)
    stations[address] = stations[address] or {}
    return stations[address]
end

local function copy(from)
    local to = {}
    for key, value in pairs(from) do to[key] = value end
    return to
end

-- Trees --------------------------------------------------------------------------------------------

-- The data of a service; octets count from 1.
local Data = {}
Data.__index = Data

function Data.new(tvb, tree)
    return setmetatable({ tvb = tvb, tree = tree, length = tvb and tvb:len() or 0 }, Data)
end

function Data:octet(number)
    if number < 1 or number > self.length then return nil end
    return self.tvb(number - 1, 1):uint()
end

-- Adds a field; nothing where the data end before.
function Data:add(key, first, last, words)
    if last > self.length or first > last then return nil end
    local item = self.tree:add(f[key], self.tvb(first - 1, last - first + 1))
    if words and words ~= "" then item:append_text(" (" .. words .. ")") end
    return item
end

function Data:number(key, first, last, words)
    if not self:add(key, first, last, words) then return nil end
    return self.tvb(first - 1, last - first + 1):uint()
end

function Data:raw(key, first, last)
    last = math.min(last or self.length, self.length)
    if first <= last then self:add(key, first, last) end
end

-- By arithmetic: no library of bits is in every Lua that Wireshark comes with.
local function has(value, bit_number) return value and math.floor(value / 2 ^ bit_number) % 2 == 1 or false end

local function told(what, value, bits)
    local set = {}
    local others = value
    for _, row in ipairs(bits) do
        if has(value, row[1]) then
            others = others - 2 ^ row[1]
            set[#set + 1] = row[2]
        end
    end
    if others > 0 then set[#set + 1] = "others" end
    if #set == 0 then return "no " .. what end
    return what .. (#set > 1 and "s: " or ": ") .. table.concat(set, ", ")
end

local function groups(octet, none)
    local numbers = {}
    for number = 0, 7 do
        if has(octet, number) then numbers[#numbers + 1] = tostring(number + 1) end
    end
    return #numbers == 0 and none or "group " .. table.concat(numbers, ", ")
end

local function hex4(value) return string.format("%04Xh", value) end

-- Services -----------------------------------------------------------------------------------------

local function is_encoder(of)
    if proto.prefs.profile == ENCODER then return true end
    return proto.prefs.profile == AUTO and of.encoder or false
end

-- What the identifiers of a Chk_Cfg make: octets in, octets out; nil where they cannot be.
local function lengths(data)
    local into, out, at = 0, 0, 1
    local function add(octet, count, is_in, is_out)
        local octets = (count + 1) * (has(octet, 6) and 2 or 1)
        if is_in then into = into + octets end
        if is_out then out = out + octets end
    end
    while at <= data.length do
        local identifier = data:octet(at)
        local following = 0
        if has(identifier, 4) or has(identifier, 5) then
            add(identifier, identifier % 16, has(identifier, 4), has(identifier, 5))
        else
            for _, row in ipairs({ { 7, false }, { 6, true } }) do
                if has(identifier, row[1]) then
                    following = following + 1
                    local length = data:octet(at + following)
                    if not length then return nil end
                    add(length, length % 64, row[2], not row[2])
                end
            end
            local makers = identifier % 16
            if makers < 15 then following = following + makers end
        end
        at = at + following + 1
        if at > data.length + 1 then return nil end
    end
    if into > 244 or out > 244 or data.length == 0 then return nil end
    return into, out
end

local function identifiers(data)
    local at = 1
    while at <= data.length do
        local identifier = data:octet(at)
        local following = 0
        if not (has(identifier, 4) or has(identifier, 5)) then
            following = (has(identifier, 7) and 1 or 0) + (has(identifier, 6) and 1 or 0)
            if identifier % 16 < 15 then following = following + identifier % 16 end
        end
        data:add("Identifier", at, math.min(at + following, data.length))
        at = at + following + 1
    end
    local into, out = lengths(data)
    if not into then
        data.tree:add_proto_expert_info(e.data, "The identifiers are malformed, or too many octets")
        return "no valid configuration"
    end
    return string.format("%d in, %d out", into, out)
end

-- The encoder's parameters can be no other slave's.
local function parameters_fit(data)
    if data.length == 9 then return data:octet(5) == 0x10 and data:octet(6) == 0x8B end
    if data.length ~= 25 and data.length ~= 26 then return false end
    -- Bits 7 to 4 and 2 are 0, bit 1 is 1.
    local octet_9 = data:octet(9)
    if octet_9 >= 16 or has(octet_9, 2) or not has(octet_9, 1) then return false end
    for octet = 18, 25 do
        if data:octet(octet) ~= 0 then return false end
    end
    return true
end

local function encoder_parameters(data)
    local octet_9 = data:octet(9)
    for _, key in ipairs({ "code_sequence", "class_2", "commissioning_diagnostics", "scaling" }) do
        data:add("encoder." .. key, 9, 9)
    end
    local scaled = data.length >= 25 and has(octet_9, 3)
    local ignored = scaled and "" or "without effect, scaling is off"
    local units = data:number("encoder.measuring_units_per_revolution", 10, 13, ignored)
    local range = data:number("encoder.total_measuring_range", 14, 17, ignored)
    data:raw("encoder.reserved", 18, 25)
    local time_base = data:number("encoder.time_base", 26, 26)
    data:raw("rest", 27)
    local words = { has(octet_9, 0) and "counter-clockwise" or "clockwise" }
    if range then
        words[#words + 1] = scaled and string.format("%d units a turn, %d in all", units, range) or "scaling off"
    end
    if time_base then words[#words + 1] = TIME_BASES[time_base] or "no such time base" end
    return table.concat(words, ", ")
end

local function set_prm(data, of)
    for _, key in ipairs({ "Lock_Req", "Unlock_Req", "Sync_Req", "Freeze_Req", "WD_On" }) do data:add(key, 1, 1) end
    local status = data:octet(1)
    data:number("WD_Fact_1", 2, 2)
    local span = ""
    if data.length >= 3 and has(status, 3) then
        local unit = has(data:octet(8), 2) and 1 or 10
        span = string.format("watchdog of %d ms", data:octet(2) * data:octet(3) * unit)
    end
    data:number("WD_Fact_2", 3, 3, span)
    data:number("min_Tsdr", 4, 4, data:octet(4) == 0 and "as before" or "bit times")
    local ident = data:number("Ident_Number", 5, 6)
    data:add("Group_Ident", 7, 7, data:octet(7) and groups(data:octet(7), "no group"))
    for _, key in ipairs({ "DPV1_Enable", "Fail_Safe", "Publisher_Enable", "WD_Base", "Dis_Stop_Control", "Dis_Start_Control" }) do
        data:add(key, 8, 8)
    end
    if data.length < 7 then
        data.tree:add_proto_expert_info(e.data, "Set_Prm has at least 7 octets")
        return "too short"
    end
    local locks = has(status, 7) and not has(status, 6)
    local words = locks and "lock" or has(status, 6) and "unlock" or "min T_SDR only"
    words = words .. ", ident " .. hex4(ident)
    if span ~= "" then words = words .. ", " .. span end
    if locks and is_encoder(of) and data.length >= 9 then
        words = words .. "; " .. encoder_parameters(data)
    else
        data:raw("User_Prm_Data", 9)
    end
    return words
end

local function global_control(data)
    for _, key in ipairs({ "Clear_Data", "Unfreeze", "Freeze", "Unsync", "Sync" }) do data:add(key, 1, 1) end
    data:add("Group_Select", 2, 2, data:octet(2) and groups(data:octet(2), "all slaves"))
    data:raw("rest", 3)
    if data.length ~= 2 then
        data.tree:add_proto_expert_info(e.data, "Global_Control has 2 octets of data")
        return "not valid"
    end
    local command, words = data:octet(1), {}
    if has(command, 5) or has(command, 4) then words[1] = has(command, 4) and "Unsync" or "Sync" end
    if has(command, 3) or has(command, 2) then words[#words + 1] = has(command, 2) and "Unfreeze" or "Freeze" end
    words[#words + 1] = has(command, 1) and "Clear" or "Operate"
    return table.concat(words, ", ") .. " for " .. groups(data:octet(2), "all slaves")
end

local function set_slave_add(data)
    local address = data:number("New_Slave_Add", 1, 1)
    local ident = data:number("Ident_Number", 2, 3)
    data:number("No_Add_Chg", 4, 4, data:octet(4) == 0 and "may be changed again" or "no further change wanted")
    data:raw("Rem_Slave_Data", 5)
    if data.length < 4 then
        data.tree:add_proto_expert_info(e.data, "Set_Slave_Add has at least 4 octets of data")
        return "too short"
    end
    return string.format("new address %d, for ident %s", address, hex4(ident))
end

local function outputs(data, of)
    local words = data.length .. " octets of outputs"
    if data.length == 0 then words = "no outputs" end
    if data.length == 4 and is_encoder(of) and (of.outputs == nil or of.outputs == 4) then
        data:add("encoder.preset", 1, 1)
        data:add("encoder.preset_value", 1, 4)
        local value = data.tvb(0, 4):uint()
        words = has(value, 31) and string.format("preset to %d", value % 2 ^ 31) or "no preset"
    end
    data:raw("Outputs", 1)
    return words
end

local function inputs(data, of)
    local words = data.length .. " octets of inputs"
    if data.length == 0 then words = "no inputs" end
    local fits = data.length == 4 or data.length == 12
    if of.inputs then fits = fits and data.length == of.inputs end
    if fits and is_encoder(of) then
        words = "position " .. data:number("encoder.position", 1, 4)
        if data.length == 12 then
            local unit = TIME_BASES[of.time_base] or ""
            data:add("encoder.velocity", 5, 8, unit)
            data:add("encoder.acceleration", 9, 12)
            words = string.format("%s, velocity %d %s, acceleration %d", words, data.tvb(4, 4):int(), unit, data.tvb(8, 4):int())
        end
    end
    data:raw("Inputs", 1)
    return words
end

local function encoder_diagnosis(data)
    local alarms = told("alarm", data:octet(8), ALARMS)
    data:add("encoder.header", 7, 7)
    data:add("encoder.alarms", 8, 8, alarms)
    for _, key in ipairs({ "code_sequence", "class_2", "commissioning_diagnostics", "scaling" }) do
        data:add("encoder." .. key, 9, 9)
    end
    data:add("encoder.type", 10, 10)
    data:add("encoder.singleturn_resolution", 11, 14)
    data:add("encoder.revolutions", 15, 16)
    local words = alarms
    if data.length >= 57 then
        local warnings = told("warning", data.tvb(19, 2):uint(), WARNINGS)
        words = words .. "; " .. warnings
        data:add("encoder.additional_alarms", 17, 17)
        data:add("encoder.supported_alarms", 18, 19, told("alarm", data.tvb(17, 2):uint(), ALARMS))
        data:add("encoder.warnings", 20, 21, warnings)
        data:add("encoder.supported_warnings", 22, 23, told("warning", data.tvb(21, 2):uint(), WARNINGS))
        data:add("encoder.profile_version", 24, 25, data:octet(24) .. "." .. data:octet(25))
        data:add("encoder.software_version", 26, 27, data:octet(26) .. "." .. data:octet(27))
        local hours = data.tvb(27, 4):uint()
        data:add("encoder.operating_time", 28, 31, hours == 0xFFFFFFFF and "not counted" or string.format("%.1f h", hours / 10))
        data:add("encoder.offset", 32, 35)
        data:add("encoder.manufacturer_offset", 36, 39)
        data:add("encoder.measuring_units_per_revolution", 40, 43, "in force")
        data:add("encoder.total_measuring_range", 44, 47, "in force")
        data:add("encoder.serial_number", 48, 57)
    end
    return words
end

-- The only block of a diagnosis is an encoder's.
local function diagnosis_fits(data)
    local header = data:octet(7)
    local long = header == 0x33 and data.length == 57
    local short = header == 0x0A and data.length == 16
    return (long or short) and data:octet(10) <= 8
end

local function blocks(data)
    local at = 7
    while at <= data.length do
        local header = data:octet(at)
        local kind = math.floor(header / 64)
        local length = kind == 2 and 3 or kind == 3 and 1 or header % 64
        local left = data.length + 1 - at
        if length == 0 or length > left then
            data:raw("rest", at)
            data.tree:add_proto_expert_info(e.data,
                string.format("The block says %d octets, but %d are left", length, left))
            return
        end
        local key = ({ [0] = "Device_Block", "Identifier_Block", "Channel_Block", "Diag_Revision" })[kind]
        data:add(key, at, at + length - 1)
        at = at + length
    end
end

local function slave_diag(data)
    for _, row in ipairs(DIAGNOSIS) do data:add(row[2], row[1], row[1]) end
    local owner = data:number("Master_Add", 4, 4)
    local ident = data:number("Ident_Number", 5, 6)
    if data.length < 6 then
        data.tree:add_proto_expert_info(e.data, "A diagnosis has at least 6 octets")
        return "too short"
    end
    blocks(data)
    local one, two = data:octet(1), data:octet(2)
    local state = "in data exchange"
    if has(one, 1) then state = "waits for the configuration" end
    if has(two, 0) then state = "waits for parameters" end
    data.tree:add(f.state, state):set_generated()
    local words = { state }
    for _, row in ipairs({ { one, 6, "parameters refused" }, { one, 2, "configuration refused" }, { one, 4, "function not supported" },
        { one, 3, "device fault reported" }, { two, 1, "no valid data" } }) do
        if has(row[1], row[2]) then
            words[#words + 1] = row[3]
            data.tree:add_proto_expert_info(e.diag, "Diagnosis: " .. row[3])
        end
    end
    words[#words + 1] = owner == 255 and "no owner" or "owner " .. owner
    words[#words + 1] = "ident " .. hex4(ident)
    local standard = table.concat(words, ", ")
    if diagnosis_fits(data) and proto.prefs.profile ~= STANDARD then
        return encoder_diagnosis(data) .. "; " .. standard
    end
    return standard
end

local function tell_request(service, data, of)
    if service == "Set_Prm" then return set_prm(data, of) end
    if service == "Chk_Cfg" then return identifiers(data) end
    if service == "Data_Exchange" then return outputs(data, of) end
    if service == "Global_Control" then return global_control(data) end
    if service == "Set_Slave_Add" then return set_slave_add(data) end
    data:raw("Data", 1)
    return ""
end

local function tell_response(service, data, of)
    if service == "Slave_Diag" then return slave_diag(data) end
    if service == "Get_Cfg" then return identifiers(data) end
    if service == "Data_Exchange" or service == "RD_Inp" then return inputs(data, of) end
    if service == "RD_Outp" then return outputs(data, of) end
    data:raw("Data", 1)
    return data.length .. " octets of data"
end

-- What a telegram teaches; runs once for each packet, in their order.

-- A retry has the same source, function and SAPs, and the same frame count bit.
local function is_retry(head)
    local low = head.fc % 16
    if low ~= 3 and low ~= 5 and low ~= 12 and low ~= 13 or head.da == 127 then return false end
    local of = station(head.da)
    local fcb, fcv = has(head.fc, 5), has(head.fc, 4)
    local this = string.format("%d %d %s %s %s", head.sa, low, tostring(head.dsap), tostring(head.ssap), tostring(fcb))
    local retry = fcv and of.last == this
    of.last = (fcb or fcv) and this or nil
    return retry
end

local function learn_request(head, data)
    if head.da == 127 then return end
    local of = station(head.da)
    if head.service == "Set_Prm" and data.length >= 7 then
        of.before = { of.time_base, of.inputs, of.outputs }
        local status = data:octet(1)
        if has(status, 7) and not has(status, 6) then
            of.encoder = of.encoder or parameters_fit(data)
            of.time_base = data.length == 26 and data:octet(26) or nil
        elseif has(status, 6) then
            of.time_base, of.inputs, of.outputs = nil, nil, nil
        end
    elseif head.service == "Chk_Cfg" then
        of.before = { of.time_base, of.inputs, of.outputs }
        of.inputs, of.outputs = lengths(data)
    end
end

local function learn_response(head, data)
    local of = station(head.sa)
    if head.fc % 16 == 3 and of.before and (head.service == "Set_Prm" or head.service == "Chk_Cfg") then
        of.time_base, of.inputs, of.outputs = of.before[1], of.before[2], of.before[3]
    elseif head.service == "Slave_Diag" and data.length >= 6 then
        of.encoder = of.encoder or diagnosis_fits(data)
        if has(data:octet(2), 0) then of.time_base = nil end
        if has(data:octet(2), 0) or has(data:octet(1), 2) then of.inputs, of.outputs = nil, nil end
    end
end

local function service_of_request(fc, dsap)
    local low = fc % 16
    if low == 9 then return "FDL_Status" end
    if low == 14 then return "Ident" end
    if low == 15 then return "LSAP_Status" end
    if low == 12 or low == 13 then return dsap == nil and "Data_Exchange" or SERVICES[dsap] end
    if (low == 4 or low == 6) and dsap == 58 then return "Global_Control" end
    return nil
end

-- What a packet is, with all that came before; the first time it is remembered.
local function context(pinfo, at, head, data)
    local key = pinfo.number * 65536 + at
    if memory[key] then return memory[key] end
    local now = { time = pinfo.abs_ts, number = pinfo.number }
    local is_request = head.fc and has(head.fc, 6)
    if is_request then
        head.service = service_of_request(head.fc, head.dsap)
        now.service, now.retry = head.service, is_retry(head)
        learn_request(head, data)
        now.of = copy(head.da == 127 and {} or station(head.da))
        local low = head.fc % 16
        local answered = low ~= 4 and low ~= 6 and low ~= 7 and low ~= 0 and head.da ~= 127
        pending = answered and { head = head, now = now } or nil
    else
        local request = pending
        pending = nil
        if head.fc and request and (request.head.da ~= head.sa or request.head.sa ~= head.da) then request = nil end
        if request then
            now.request, request.now.response = request.now, now
            now.asked = request.head
        end
        if head.fc then
            now.service = head.ssap and SERVICES[head.ssap] or request and request.now.service
            if not now.service and data.length > 0 then now.service = "Data_Exchange" end
            head.service = now.service
            learn_response(head, data)
            now.of = copy(station(head.sa))
        elseif request and not head.token then
            now.service = request.now.service
        end
    end
    memory[key] = now
    return now
end

-- Telegrams ----------------------------------------------------------------------------------------

local function links(tree, now)
    if now.response then tree:add(f.response_in, now.response.number):set_generated() end
    if now.request then
        tree:add(f.response_to, now.request.number):set_generated()
        local span = now.time - now.request.time
        tree:add(f.response_time, NSTime.new(math.floor(span), math.floor((span % 1) * 1e9 + 0.5))):set_generated()
    end
    if now.service then tree:add(f.Service, now.service):set_generated() end
end

-- One octet; the request before tells what about.
local function acknowledgement(pinfo, at, tree)
    local now = context(pinfo, at, {}, Data.new(nil, tree))
    tree:add(f.Direction, "response"):set_generated()
    links(tree, now)
    if not now.asked then
        tree:add_proto_expert_info(e.alone)
        return "short acknowledgement"
    end
    return string.format("%d -> %d  %s: received", now.asked.da, now.asked.sa, now.service or "request")
end

local function token(tvb, pinfo, at, tree)
    context(pinfo, at, { token = true }, Data.new(nil, tree))
    tree:add(f.DA, tvb(at + 1, 1))
    tree:add(f.SA, tvb(at + 2, 1))
    tree:add(f.Direction, "token"):set_generated()
    return string.format("%d -> %d  token", tvb(at + 2, 1):uint(), tvb(at + 1, 1):uint())
end

-- What is wrong with the format, and where (an offset).
local function fault(tvb, at, length)
    local first = tvb(at, 1):uint()
    if first == 0x68 then
        local le, again, second = tvb(at + 1, 1):uint(), tvb(at + 2, 1):uint(), tvb(at + 3, 1):uint()
        if le ~= again then return e.le, string.format("The length is repeated as %d, but octet 2 says %d", again, le), 2 end
        if le < 4 or le > 249 then return e.le, string.format("A length of %d, but 4 to 249 are possible", le), 1 end
        if second ~= 0x68 then return e.sd, string.format("Octet 4 is %02Xh, but 68h is due", second), 3 end
    end
    if length > tvb:len() - at then
        return e.short, string.format("It ends here, but %d more octets are due", length - (tvb:len() - at)), tvb:len() - at - 1
    end
    return nil
end

local function function_code(tvb, at, fc, tree)
    local branch = tree:add(f.FC, tvb(at, 1))
    branch:add(f.Request, tvb(at, 1))
    if has(fc, 6) then
        branch:add(f.FCB, tvb(at, 1))
        branch:add(f.FCV, tvb(at, 1))
        branch:add(f.Function, tvb(at, 1))
    else
        branch:add(f.Station_Type, tvb(at, 1))
        branch:add(f.Response_Code, tvb(at, 1))
    end
end

-- Check sum and end delimiter; whether both are right.
local function ending(tvb, from, to, tree)
    local sum = 0
    for place = from, to - 3 do sum = (sum + tvb(place, 1):uint()) % 256 end
    local fcs, ed = tvb(to - 2, 1):uint(), tvb(to - 1, 1):uint()
    local item, last = tree:add(f.FCS, tvb(to - 2, 1)), tree:add(f.ED, tvb(to - 1, 1))
    if fcs ~= sum then
        item:add_proto_expert_info(e.fcs, string.format("The check sum is %02Xh, but the octets make %02Xh", fcs, sum))
    elseif ed ~= 0x16 then
        last:add_proto_expert_info(e.ed, string.format("%02Xh, but a telegram ends with 16h", ed))
    end
    return fcs == sum and ed == 0x16
end

local function saps(tvb, head, place, last, tree)
    for _, row in ipairs({ { "DSAP", "dsap", head.da_octet }, { "SSAP", "ssap", head.sa_octet } }) do
        if row[3] >= 128 then
            if place > last then
                tree:add_proto_expert_info(e.sap)
                return nil
            end
            tree:add(f[row[1]], tvb(place, 1))
            head[row[2]] = tvb(place, 1):uint()
            place = place + 1
        end
    end
    return place
end

local function words_of_request(head, now, data, tree)
    local words = tell_request(now.service, data, now.of)
    local to = head.da == 127 and "all" or tostring(head.da)
    local name = now.service or FUNCTIONS[head.fc % 16] or "reserved"
    local retry = ""
    if now.retry then
        tree:add(f.Retry, true):set_generated()
        tree:add_proto_expert_info(e.retry)
        retry = " (retry)"
    end
    return string.format("%d -> %s  %s%s%s", head.sa, to, name, words == "" and " request" or ": " .. words, retry)
end

local function words_of_response(head, now, data, tree)
    local code = head.fc % 16
    local words
    if not now.request then tree:add_proto_expert_info(e.alone) end
    if now.service and (code == 8 or code == 10 or code == 12 or code == 13) then
        words = tell_response(now.service, data, now.of)
    else
        data:raw("Data", 1)
        words = RESPONSES[code] or "reserved"
        if code >= 1 and code <= 3 then tree:add_proto_expert_info(e.refused, words) end
    end
    local waits = code == 10 and " (a diagnosis waits)" or ""
    return string.format("%d -> %d  %s: %s%s", head.sa, head.da, now.service or "answer", words, waits)
end

-- SD1, SD2 or SD3: its words.
local function telegram(tvb, pinfo, at, length, tree)
    local first = tvb(at, 1):uint()
    local from = at + (first == 0x68 and 4 or 1)
    local to = at + length
    if first == 0x68 then tree:add(f.LE, tvb(at + 1, 1)) end
    local head = { da_octet = tvb(from, 1):uint(), sa_octet = tvb(from + 1, 1):uint(), fc = tvb(from + 2, 1):uint() }
    head.da, head.sa = head.da_octet % 128, head.sa_octet % 128
    tree:add(f.DA, tvb(from, 1))
    tree:add(f.SA, tvb(from + 1, 1))
    function_code(tvb, from + 2, head.fc, tree)
    local place = saps(tvb, head, from + 3, to - 3, tree)
    -- Nothing of a bad telegram counts.
    if not ending(tvb, from, to, tree) or not place then
        pending = nil
        return "bad telegram"
    end
    local range = place <= to - 3 and tvb(place, to - 2 - place) or nil
    local data = Data.new(range and range:tvb(), tree)
    local now = context(pinfo, at, head, data)
    local is_request = has(head.fc, 6)
    tree:add(f.Direction, is_request and "request" or "response"):set_generated()
    links(tree, now)
    return (is_request and words_of_request or words_of_response)(head, now, data, tree)
end

-- How long the telegram at an offset is; nil where none begins.
local function extent(tvb, at)
    local left = tvb:len() - at
    local first = tvb(at, 1):uint()
    if first == 0x68 then return left >= 4 and tvb(at + 1, 1):uint() + 6 or math.max(left + 1, 4) end
    return ({ [0x10] = 6, [0xA2] = 14, [0xDC] = 3, [0xE5] = 1 })[first]
end

-- Puts one telegram into the tree: its words, and where the next one begins.
local function one(tvb, pinfo, at, root)
    local left = tvb:len() - at
    local length = extent(tvb, at)
    local tree = root:add(proto, tvb(at, math.min(length or left, left)))
    if not length then
        pending = nil
        tree:add(tvb(at, left), "Octets that begin no telegram")
        tree:add_proto_expert_info(e.sd, string.format("%02Xh begins no telegram", tvb(at, 1):uint()))
        return left .. " octets that begin no telegram", tvb:len()
    end
    tree:add(f.format, tvb(at, 1))
    local wrong, why, where
    if left < 4 and tvb(at, 1):uint() == 0x68 then
        wrong, why, where = e.short, "It ends here, within its header", left - 1
    else
        wrong, why, where = fault(tvb, at, length)
    end
    if wrong then
        pending = nil
        if where >= 1 and tvb(at, 1):uint() == 0x68 then tree:add(f.LE, tvb(at + 1, 1)) end
        tree:add_tvb_expert_info(wrong, tvb(at + where, 1), why)
        tree:append_text(", bad")
        return "bad telegram: " .. why, tvb:len()
    end
    local first, words = tvb(at, 1):uint(), nil
    if first == 0xE5 then
        words = acknowledgement(pinfo, at, tree)
    elseif first == 0xDC then
        words = token(tvb, pinfo, at, tree)
    else
        words = telegram(tvb, pinfo, at, length, tree)
    end
    tree:append_text(", " .. words)
    return words, at + length
end

function proto.dissector(tvb, pinfo, root)
    pinfo.cols.protocol = "PROFIBUS DP"
    if tvb:len() == 0 then
        pinfo.cols.info = "an event, see the comment of the packet"
        return 0
    end
    local at, words = 0, {}
    while at < tvb:len() do
        words[#words + 1], at = one(tvb, pinfo, at, root)
    end
    pinfo.cols.info = table.concat(words, " | ")
    return tvb:len()
end

-- USER0 is link type 147. Wireshark 4 has no name of its own for 257; it hands such packets, and those of all other
-- networks that it does not know, to 0.
local encapsulations = DissectorTable.get("wtap_encap")
encapsulations:add((wtap_encaps or wtap).USER0, proto)
local named = (wtap_encaps or wtap).PROFIBUS_DL
encapsulations:add(named or 0, proto)
