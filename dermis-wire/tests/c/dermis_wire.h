/* The wire protocol between a skin's instrument and its host, both sides, in C99 without malloc.
 *
 * Written from docs/wire-protocol.md, which says what every field means. Nothing here reads past the bytes it is given;
 * a message that does not fit its layout is refused. */
#ifndef DERMIS_WIRE_H
#define DERMIS_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DW_VERSION 1u

/* Bytes of a message's packet at most: checksum, COBS, both zero bytes. */
#define DW_PACKET_BYTES(message_bytes) ((message_bytes) + 4u + ((message_bytes) + 4u + 253u) / 254u + 2u)
/* Bytes of a frame's message. */
#define DW_FRAME_BYTES(count, reading_bytes) (16u + (count) * (reading_bytes))

enum {
    DW_HELLO = 0x01,
    DW_FRAME = 0x02,
    DW_STATUS = 0x03,
    DW_FAULT = 0x04,
    DW_IDENTIFY = 0x81,
    DW_START = 0x82,
    DW_STOP = 0x83,
    DW_SCAN = 0x84,
    DW_RATE = 0x85,
    DW_SELF_TEST = 0x86
};

enum { DW_SATURATED = 0x01, DW_OVERRUN = 0x02, DW_TEST = 0x04, DW_WIDE = 0x80 };

enum {
    DW_FAULT_UNKNOWN_MESSAGE = 1,
    DW_FAULT_SCAN_TABLE = 2,
    DW_FAULT_RATE = 3,
    DW_FAULT_LINE = 4,
    DW_FAULT_HARDWARE = 5
};

/* An input that is on the reference resistor, as is the other of its slot. */
#define DW_REFERENCE 0xFFFFu
/* Slots that a scan message carries at most. */
#define DW_SCAN_MOST 64u

/* ---- Sending: begin, put the message's bytes in their order, end. ---- */

typedef struct {
    uint8_t *out;
    size_t room, length, code_at;
    uint32_t crc;
    bool fits;
} dw_writer;

void dw_begin(dw_writer *writer, uint8_t *out, size_t room);
void dw_put(dw_writer *writer, const uint8_t *bytes, size_t count);
void dw_put_u8(dw_writer *writer, uint8_t value);
void dw_put_u16(dw_writer *writer, uint16_t value);
void dw_put_u32(dw_writer *writer, uint32_t value);
void dw_put_u64(dw_writer *writer, uint64_t value);
void dw_put_f32(dw_writer *writer, float value);
/* Bytes of the packet; 0 where it did not fit. */
size_t dw_end(dw_writer *writer);

/* ---- Receiving: byte by byte. ---- */

typedef enum { DW_NOTHING, DW_MESSAGE, DW_DAMAGED } dw_found;

/* `buffer` holds a message and its checksum: four bytes more than the longest message that is to be understood. */
typedef struct {
    uint8_t *buffer;
    size_t room, length;
    /* Bytes of the message in `buffer` after DW_MESSAGE, until the next byte is taken. */
    size_t message_bytes;
    uint8_t left;
    bool begun, zero_due, bad;
} dw_receiver;

void dw_receiver_init(dw_receiver *receiver, uint8_t *buffer, size_t room);
dw_found dw_receive(dw_receiver *receiver, uint8_t byte);

/* ---- Messages. Texts and readings of a parsed message lie in its bytes. ---- */

typedef struct {
    uint16_t version;
    uint8_t reading_bytes;
    uint8_t design_sha256[32];
    uint16_t electrode_count, slot_count;
    float reference_ohm, source_v, volts_per_count[3];
    uint32_t full_scale, rate_millihertz, highest_rate_millihertz, baud, serial, boot;
    const uint8_t *name; /* UTF-8, not ended by a zero byte */
    uint8_t name_bytes;
} dw_hello;

typedef struct {
    uint8_t flags; /* DW_WIDE says how long its readings are */
    uint16_t count;
    uint32_t sequence;
    uint64_t time_us;
    const uint8_t *readings; /* of a parsed frame: see dw_reading */
} dw_frame;

typedef struct {
    uint32_t uptime_ms, frames, dropped, damaged;
    int16_t temperature_cc;
    uint16_t supply_mv;
} dw_status;

typedef struct {
    uint8_t code;
    const uint8_t *text; /* UTF-8, not ended by a zero byte */
    uint8_t text_bytes;
} dw_fault;

typedef struct {
    uint16_t source, sink, plus, minus;
} dw_slot;

typedef struct {
    uint16_t first, total, count;
    const uint8_t *slots; /* of a parsed part: see dw_slot_at */
} dw_scan;

/* Each is false where the message is none of that kind. */
bool dw_parse_hello(const uint8_t *message, size_t bytes, dw_hello *hello);
bool dw_parse_frame(const uint8_t *message, size_t bytes, dw_frame *frame);
bool dw_parse_status(const uint8_t *message, size_t bytes, dw_status *status);
bool dw_parse_fault(const uint8_t *message, size_t bytes, dw_fault *fault);
bool dw_parse_scan(const uint8_t *message, size_t bytes, dw_scan *scan);
bool dw_parse_rate(const uint8_t *message, size_t bytes, uint32_t *rate_millihertz);
/* Reading k of a parsed frame, k below its count. */
int32_t dw_reading(const dw_frame *frame, size_t k);
/* Slot k of a parsed part, k below its count. */
dw_slot dw_slot_at(const dw_scan *scan, size_t k);

/* Each gives the bytes of its packet, 0 where they do not fit. */
size_t dw_write_hello(uint8_t *out, size_t room, const dw_hello *hello);
/* `readings` are `frame->count` of them; `frame->readings` is not looked at, DW_WIDE is set by the function. */
size_t dw_write_frame_i16(uint8_t *out, size_t room, const dw_frame *frame, const int16_t *readings);
size_t dw_write_frame_i32(uint8_t *out, size_t room, const dw_frame *frame, const int32_t *readings);
size_t dw_write_status(uint8_t *out, size_t room, const dw_status *status);
size_t dw_write_fault(uint8_t *out, size_t room, const dw_fault *fault);
/* A message of its kind alone: identify, start, stop, self-test. */
size_t dw_write_kind(uint8_t *out, size_t room, uint8_t kind);
/* `slots` are `scan->count` of them; `scan->slots` is not looked at. */
size_t dw_write_scan(uint8_t *out, size_t room, const dw_scan *scan, const dw_slot *slots);
size_t dw_write_rate(uint8_t *out, size_t room, uint32_t rate_millihertz);

/* Reading k of a self-test's frame. */
int16_t dw_test_reading(uint16_t k);

uint32_t dw_crc32c(const uint8_t *bytes, size_t count);

#endif
