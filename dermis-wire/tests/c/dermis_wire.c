#include "dermis_wire.h"

#include <string.h>

/* ---- Checksum: CRC-32C, four bits at a time, so that the table is 64 bytes. ---- */

static uint32_t crc_add(uint32_t crc, uint8_t byte)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x105EC76Fu, 0x20BD8EDEu, 0x30E349B1u, 0x417B1DBCu, 0x5125DAD3u, 0x61C69362u, 0x7198540Du,
        0x82F63B78u, 0x92A8FC17u, 0xA24BB5A6u, 0xB21572C9u, 0xC38D26C4u, 0xD3D3E1ABu, 0xE330A81Au, 0xF36E6F75u
    };
    crc ^= byte;
    crc = table[crc & 15u] ^ (crc >> 4);
    return table[crc & 15u] ^ (crc >> 4);
}

uint32_t dw_crc32c(const uint8_t *bytes, size_t count)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < count; i++)
        crc = crc_add(crc, bytes[i]);
    return ~crc;
}

/* ---- Sending ---- */

static void raw(dw_writer *writer, uint8_t byte)
{
    if (writer->length < writer->room)
        writer->out[writer->length++] = byte;
    else
        writer->fits = false;
}

/* A byte into the COBS block that is open; where that was full, into a new one. A block's length is known when the next
 * begins, so its code byte is counted up in place. */
static void cobs(dw_writer *writer, uint8_t byte)
{
    if (!writer->fits)
        return;
    if (writer->out[writer->code_at] == 0xFF) {
        writer->code_at = writer->length;
        raw(writer, 1);
    }
    if (byte == 0)
        writer->code_at = writer->length;
    raw(writer, byte == 0 ? 1 : byte);
    if (byte != 0 && writer->fits)
        writer->out[writer->code_at]++;
}

void dw_begin(dw_writer *writer, uint8_t *out, size_t room)
{
    *writer = (dw_writer){ .out = out, .room = room, .code_at = 1, .crc = 0xFFFFFFFFu, .fits = true };
    raw(writer, 0);
    raw(writer, 1);
}

void dw_put(dw_writer *writer, const uint8_t *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        writer->crc = crc_add(writer->crc, bytes[i]);
        cobs(writer, bytes[i]);
    }
}

void dw_put_u8(dw_writer *writer, uint8_t value)
{
    dw_put(writer, &value, 1);
}

void dw_put_u16(dw_writer *writer, uint16_t value)
{
    const uint8_t bytes[2] = { (uint8_t)(value & 0xFFu), (uint8_t)(value >> 8) };
    dw_put(writer, bytes, 2);
}

void dw_put_u32(dw_writer *writer, uint32_t value)
{
    dw_put_u16(writer, (uint16_t)(value & 0xFFFFu));
    dw_put_u16(writer, (uint16_t)(value >> 16));
}

void dw_put_u64(dw_writer *writer, uint64_t value)
{
    dw_put_u32(writer, (uint32_t)(value & 0xFFFFFFFFu));
    dw_put_u32(writer, (uint32_t)(value >> 32));
}

void dw_put_f32(dw_writer *writer, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    dw_put_u32(writer, bits);
}

size_t dw_end(dw_writer *writer)
{
    const uint32_t crc = ~writer->crc;
    dw_put_u32(writer, crc);
    raw(writer, 0);
    return writer->fits ? writer->length : 0;
}

/* ---- Receiving ---- */

static void forget(dw_receiver *receiver)
{
    receiver->length = 0;
    receiver->left = 0;
    receiver->begun = receiver->zero_due = receiver->bad = false;
}

static void keep(dw_receiver *receiver, uint8_t byte)
{
    if (receiver->length < receiver->room)
        receiver->buffer[receiver->length++] = byte;
    else
        receiver->bad = true;
}

static uint32_t u32_at(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

void dw_receiver_init(dw_receiver *receiver, uint8_t *buffer, size_t room)
{
    *receiver = (dw_receiver){ .buffer = buffer, .room = room };
}

dw_found dw_receive(dw_receiver *receiver, uint8_t byte)
{
    if (byte != 0) {
        receiver->begun = true;
        if (receiver->left > 0) {
            keep(receiver, byte);
            receiver->left--;
        } else {
            /* The zero byte of the block before is meant only now that another follows. */
            if (receiver->zero_due)
                keep(receiver, 0);
            receiver->left = (uint8_t)(byte - 1);
            receiver->zero_due = byte != 0xFF;
        }
        return DW_NOTHING;
    }
    if (!receiver->begun)
        return DW_NOTHING;
    const size_t length = receiver->length;
    const bool whole = !receiver->bad && receiver->left == 0 && length >= 4;
    forget(receiver);
    if (!whole || dw_crc32c(receiver->buffer, length - 4) != u32_at(receiver->buffer + length - 4))
        return DW_DAMAGED;
    receiver->message_bytes = length - 4;
    return DW_MESSAGE;
}

/* ---- Parsing ---- */

typedef struct {
    const uint8_t *at;
    size_t left;
    bool enough;
} reader;

static const uint8_t *take(reader *from, size_t count)
{
    static const uint8_t none[8] = { 0 };
    if (count > from->left) {
        from->enough = false;
        from->left = 0;
        return none;
    }
    const uint8_t *bytes = from->at;
    from->at += count;
    from->left -= count;
    return bytes;
}

static uint8_t take_u8(reader *from)
{
    return take(from, 1)[0];
}

static uint16_t u16_at(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | bytes[1] << 8);
}

static uint16_t take_u16(reader *from)
{
    return u16_at(take(from, 2));
}

static uint32_t take_u32(reader *from)
{
    return u32_at(take(from, 4));
}

static float take_f32(reader *from)
{
    const uint32_t bits = take_u32(from);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Two's complement without relying on what the compiler makes of it. */
static int32_t i16_of(uint16_t bits)
{
    return bits < 0x8000u ? (int32_t)bits : (int32_t)bits - 0x10000;
}

static int32_t i32_of(uint32_t bits)
{
    return bits <= 0x7FFFFFFFu ? (int32_t)bits : -(int32_t)(0xFFFFFFFFu - bits) - 1;
}

static bool opens(reader *from, const uint8_t *message, size_t bytes, uint8_t kind)
{
    *from = (reader){ .at = message, .left = bytes, .enough = true };
    return take_u8(from) == kind;
}

/* Whether the message held all its fields and nothing more. */
static bool closes(const reader *from)
{
    return from->enough && from->left == 0;
}

bool dw_parse_hello(const uint8_t *message, size_t bytes, dw_hello *hello)
{
    reader from;
    if (!opens(&from, message, bytes, DW_HELLO))
        return false;
    hello->reading_bytes = take_u8(&from);
    hello->version = take_u16(&from);
    for (size_t i = 0; i < 32; i++)
        hello->design_sha256[i] = take_u8(&from);
    hello->electrode_count = take_u16(&from);
    hello->slot_count = take_u16(&from);
    hello->reference_ohm = take_f32(&from);
    hello->source_v = take_f32(&from);
    for (size_t i = 0; i < 3; i++)
        hello->volts_per_count[i] = take_f32(&from);
    hello->full_scale = take_u32(&from);
    hello->rate_millihertz = take_u32(&from);
    hello->highest_rate_millihertz = take_u32(&from);
    hello->baud = take_u32(&from);
    hello->serial = take_u32(&from);
    hello->boot = take_u32(&from);
    hello->name_bytes = take_u8(&from);
    hello->name = take(&from, hello->name_bytes);
    return closes(&from) && (hello->reading_bytes == 2 || hello->reading_bytes == 4);
}

bool dw_parse_frame(const uint8_t *message, size_t bytes, dw_frame *frame)
{
    reader from;
    if (!opens(&from, message, bytes, DW_FRAME))
        return false;
    frame->flags = take_u8(&from);
    frame->count = take_u16(&from);
    frame->sequence = take_u32(&from);
    const uint32_t low = take_u32(&from);
    frame->time_us = (uint64_t)take_u32(&from) << 32 | low;
    frame->readings = take(&from, (size_t)frame->count * (frame->flags & DW_WIDE ? 4u : 2u));
    return closes(&from);
}

bool dw_parse_status(const uint8_t *message, size_t bytes, dw_status *status)
{
    reader from;
    if (!opens(&from, message, bytes, DW_STATUS))
        return false;
    status->uptime_ms = take_u32(&from);
    status->frames = take_u32(&from);
    status->dropped = take_u32(&from);
    status->damaged = take_u32(&from);
    status->temperature_cc = (int16_t)i16_of(take_u16(&from));
    status->supply_mv = take_u16(&from);
    return closes(&from);
}

bool dw_parse_fault(const uint8_t *message, size_t bytes, dw_fault *fault)
{
    reader from;
    if (!opens(&from, message, bytes, DW_FAULT))
        return false;
    fault->code = take_u8(&from);
    fault->text_bytes = take_u8(&from);
    fault->text = take(&from, fault->text_bytes);
    return closes(&from);
}

static bool scan_fits(const dw_scan *scan)
{
    return scan->count <= DW_SCAN_MOST && (uint32_t)scan->first + scan->count <= scan->total;
}

bool dw_parse_scan(const uint8_t *message, size_t bytes, dw_scan *scan)
{
    reader from;
    if (!opens(&from, message, bytes, DW_SCAN))
        return false;
    scan->first = take_u16(&from);
    scan->total = take_u16(&from);
    scan->count = take_u16(&from);
    scan->slots = take(&from, (size_t)scan->count * 8);
    return closes(&from) && scan_fits(scan);
}

bool dw_parse_rate(const uint8_t *message, size_t bytes, uint32_t *rate_millihertz)
{
    reader from;
    if (!opens(&from, message, bytes, DW_RATE))
        return false;
    *rate_millihertz = take_u32(&from);
    return closes(&from);
}

int32_t dw_reading(const dw_frame *frame, size_t k)
{
    if (frame->flags & DW_WIDE)
        return i32_of(u32_at(frame->readings + 4 * k));
    return i16_of(u16_at(frame->readings + 2 * k));
}

dw_slot dw_slot_at(const dw_scan *scan, size_t k)
{
    const uint8_t *bytes = scan->slots + 8 * k;
    return (dw_slot){ u16_at(bytes), u16_at(bytes + 2), u16_at(bytes + 4), u16_at(bytes + 6) };
}

/* ---- Messages to send ---- */

size_t dw_write_hello(uint8_t *out, size_t room, const dw_hello *hello)
{
    dw_writer writer;
    if (hello->reading_bytes != 2 && hello->reading_bytes != 4)
        return 0;
    dw_begin(&writer, out, room);
    dw_put_u8(&writer, DW_HELLO);
    dw_put_u8(&writer, hello->reading_bytes);
    dw_put_u16(&writer, hello->version);
    dw_put(&writer, hello->design_sha256, 32);
    dw_put_u16(&writer, hello->electrode_count);
    dw_put_u16(&writer, hello->slot_count);
    dw_put_f32(&writer, hello->reference_ohm);
    dw_put_f32(&writer, hello->source_v);
    for (size_t i = 0; i < 3; i++)
        dw_put_f32(&writer, hello->volts_per_count[i]);
    dw_put_u32(&writer, hello->full_scale);
    dw_put_u32(&writer, hello->rate_millihertz);
    dw_put_u32(&writer, hello->highest_rate_millihertz);
    dw_put_u32(&writer, hello->baud);
    dw_put_u32(&writer, hello->serial);
    dw_put_u32(&writer, hello->boot);
    dw_put_u8(&writer, hello->name_bytes);
    dw_put(&writer, hello->name, hello->name_bytes);
    return dw_end(&writer);
}

static void frame_head(dw_writer *writer, const dw_frame *frame, bool wide)
{
    dw_put_u8(writer, DW_FRAME);
    dw_put_u8(writer, (uint8_t)((frame->flags & 0x7Fu) | (wide ? DW_WIDE : 0u)));
    dw_put_u16(writer, frame->count);
    dw_put_u32(writer, frame->sequence);
    dw_put_u64(writer, frame->time_us);
}

size_t dw_write_frame_i16(uint8_t *out, size_t room, const dw_frame *frame, const int16_t *readings)
{
    dw_writer writer;
    dw_begin(&writer, out, room);
    frame_head(&writer, frame, false);
    for (size_t k = 0; k < frame->count; k++)
        dw_put_u16(&writer, (uint16_t)readings[k]);
    return dw_end(&writer);
}

size_t dw_write_frame_i32(uint8_t *out, size_t room, const dw_frame *frame, const int32_t *readings)
{
    dw_writer writer;
    dw_begin(&writer, out, room);
    frame_head(&writer, frame, true);
    for (size_t k = 0; k < frame->count; k++)
        dw_put_u32(&writer, (uint32_t)readings[k]);
    return dw_end(&writer);
}

size_t dw_write_status(uint8_t *out, size_t room, const dw_status *status)
{
    dw_writer writer;
    dw_begin(&writer, out, room);
    dw_put_u8(&writer, DW_STATUS);
    dw_put_u32(&writer, status->uptime_ms);
    dw_put_u32(&writer, status->frames);
    dw_put_u32(&writer, status->dropped);
    dw_put_u32(&writer, status->damaged);
    dw_put_u16(&writer, (uint16_t)status->temperature_cc);
    dw_put_u16(&writer, status->supply_mv);
    return dw_end(&writer);
}

size_t dw_write_fault(uint8_t *out, size_t room, const dw_fault *fault)
{
    dw_writer writer;
    dw_begin(&writer, out, room);
    dw_put_u8(&writer, DW_FAULT);
    dw_put_u8(&writer, fault->code);
    dw_put_u8(&writer, fault->text_bytes);
    dw_put(&writer, fault->text, fault->text_bytes);
    return dw_end(&writer);
}

size_t dw_write_kind(uint8_t *out, size_t room, uint8_t kind)
{
    dw_writer writer;
    dw_begin(&writer, out, room);
    dw_put_u8(&writer, kind);
    return dw_end(&writer);
}

size_t dw_write_scan(uint8_t *out, size_t room, const dw_scan *scan, const dw_slot *slots)
{
    dw_writer writer;
    if (!scan_fits(scan))
        return 0;
    dw_begin(&writer, out, room);
    dw_put_u8(&writer, DW_SCAN);
    dw_put_u16(&writer, scan->first);
    dw_put_u16(&writer, scan->total);
    dw_put_u16(&writer, scan->count);
    for (size_t k = 0; k < scan->count; k++) {
        dw_put_u16(&writer, slots[k].source);
        dw_put_u16(&writer, slots[k].sink);
        dw_put_u16(&writer, slots[k].plus);
        dw_put_u16(&writer, slots[k].minus);
    }
    return dw_end(&writer);
}

size_t dw_write_rate(uint8_t *out, size_t room, uint32_t rate_millihertz)
{
    dw_writer writer;
    dw_begin(&writer, out, room);
    dw_put_u8(&writer, DW_RATE);
    dw_put_u32(&writer, rate_millihertz);
    return dw_end(&writer);
}

int16_t dw_test_reading(uint16_t k)
{
    return (int16_t)i16_of((uint16_t)((uint32_t)k * 40503u & 0xFFFFu));
}
