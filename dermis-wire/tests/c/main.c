/* decode: bytes from the standard input, a line for each thing found in them.
 * encode: the packets of the specification's test vectors, in their order, to the standard output. */
#include "dermis_wire.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static void print_hex(const char *name, const uint8_t *bytes, size_t count)
{
    printf(" %s=", name);
    for (size_t i = 0; i < count; i++)
        printf("%02x", bytes[i]);
}

static void print_f32(const char *name, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    printf(" %s=%08" PRIx32, name, bits);
}

static void print_hello(const dw_hello *hello)
{
    printf("hello version=%u reading_bytes=%u", hello->version, hello->reading_bytes);
    print_hex("design", hello->design_sha256, 32);
    printf(" electrodes=%u slots=%u", hello->electrode_count, hello->slot_count);
    print_f32("reference_ohm", hello->reference_ohm);
    print_f32("source_v", hello->source_v);
    for (size_t i = 0; i < 3; i++)
        print_f32("volts_per_count", hello->volts_per_count[i]);
    printf(" full_scale=%" PRIu32 " rate_millihertz=%" PRIu32, hello->full_scale, hello->rate_millihertz);
    printf(" highest_rate_millihertz=%" PRIu32 " baud=%" PRIu32, hello->highest_rate_millihertz, hello->baud);
    printf(" serial=%" PRIu32 " boot=%" PRIu32, hello->serial, hello->boot);
    print_hex("name", hello->name, hello->name_bytes);
    printf("\n");
}

static void print_frame(const dw_frame *frame)
{
    printf("frame sequence=%" PRIu32 " time_us=%" PRIu64, frame->sequence, frame->time_us);
    printf(" flags=%u wide=%u readings=", frame->flags & 0x7Fu, frame->flags >> 7);
    for (size_t k = 0; k < frame->count; k++)
        printf("%" PRId32 ",", dw_reading(frame, k));
    printf("\n");
}

static void print_scan(const dw_scan *scan)
{
    printf("scan first=%u total=%u slots=", scan->first, scan->total);
    for (size_t k = 0; k < scan->count; k++) {
        const dw_slot slot = dw_slot_at(scan, k);
        printf("%u:%u:%u:%u,", slot.source, slot.sink, slot.plus, slot.minus);
    }
    printf("\n");
}

static void print_message(const uint8_t *message, size_t bytes)
{
    dw_hello hello;
    dw_frame frame;
    dw_status status;
    dw_fault fault;
    dw_scan scan;
    uint32_t rate_millihertz;
    const unsigned kind = bytes == 1 ? message[0] : 0;
    if (dw_parse_hello(message, bytes, &hello)) {
        print_hello(&hello);
    } else if (dw_parse_frame(message, bytes, &frame)) {
        print_frame(&frame);
    } else if (dw_parse_status(message, bytes, &status)) {
        printf("status uptime_ms=%" PRIu32 " frames=%" PRIu32, status.uptime_ms, status.frames);
        printf(" dropped=%" PRIu32 " damaged=%" PRIu32, status.dropped, status.damaged);
        printf(" temperature_cc=%d supply_mv=%u\n", status.temperature_cc, status.supply_mv);
    } else if (dw_parse_fault(message, bytes, &fault)) {
        printf("fault code=%u", fault.code);
        print_hex("text", fault.text, fault.text_bytes);
        printf("\n");
    } else if (dw_parse_scan(message, bytes, &scan)) {
        print_scan(&scan);
    } else if (dw_parse_rate(message, bytes, &rate_millihertz)) {
        printf("rate %" PRIu32 "\n", rate_millihertz);
    } else if (kind == DW_IDENTIFY || kind == DW_START || kind == DW_STOP || kind == DW_SELF_TEST) {
        printf("kind %u\n", kind);
    } else {
        printf("unknown %zu bytes\n", bytes);
    }
}

static int decode(void)
{
    static uint8_t buffer[4096];
    dw_receiver receiver;
    dw_receiver_init(&receiver, buffer, sizeof buffer);
    int byte;
    while ((byte = getchar()) != EOF) {
        const dw_found found = dw_receive(&receiver, (uint8_t)byte);
        if (found == DW_DAMAGED)
            printf("damaged\n");
        else if (found == DW_MESSAGE)
            print_message(buffer, receiver.message_bytes);
    }
    return 0;
}

static uint8_t packet[4096];

static void send_packet(size_t length)
{
    fwrite(packet, 1, length, stdout);
}

static void send_commands(void)
{
    static const uint8_t kinds[4] = { DW_IDENTIFY, DW_START, DW_STOP, DW_SELF_TEST };
    for (size_t i = 0; i < 4; i++)
        send_packet(dw_write_kind(packet, sizeof packet, kinds[i]));
    send_packet(dw_write_rate(packet, sizeof packet, 120000));
    static const dw_slot slots[3] = { { 0, 1, DW_REFERENCE, DW_REFERENCE }, { 0, 1, 2, 3 }, { 0, 1, 3, 4 } };
    send_packet(dw_write_scan(packet, sizeof packet, &(dw_scan){ .first = 0, .total = 4, .count = 3 }, slots));
    static const dw_slot last = { 256, 258, 511, 0 };
    send_packet(dw_write_scan(packet, sizeof packet, &(dw_scan){ .first = 3, .total = 4, .count = 1 }, &last));
}

static void send_reports(void)
{
    static const char name[] = "gr\xC3\xB6\xC3\x9F" "e 30";
    dw_hello hello = {
        .version = DW_VERSION, .reading_bytes = 2, .electrode_count = 30, .slot_count = 900,
        .reference_ohm = 1000.0f, .source_v = 3.3f, .volts_per_count = { 0.000125f, 0.00125f, 0.0005f },
        .full_scale = 2047, .rate_millihertz = 120000, .highest_rate_millihertz = 2000000, .baud = 0, .serial = 42,
        .boot = 0xDEADBEEFu, .name = (const uint8_t *)name, .name_bytes = sizeof name - 1
    };
    for (uint8_t i = 0; i < 32; i++)
        hello.design_sha256[i] = i;
    send_packet(dw_write_hello(packet, sizeof packet, &hello));
    const dw_status status = { 60000, 7200, 3, 1, -512, 5000 };
    send_packet(dw_write_status(packet, sizeof packet, &status));
    static const char text[] = "at most 120 Hz";
    dw_fault fault = { DW_FAULT_RATE, (const uint8_t *)text, sizeof text - 1 };
    send_packet(dw_write_fault(packet, sizeof packet, &fault));
    /* No zero byte in it: a buffer of exactly as many bytes as a packet can have. */
    static uint8_t letters[247];
    memset(letters, 'u', sizeof letters);
    fault = (dw_fault){ DW_FAULT_HARDWARE, letters, sizeof letters };
    send_packet(dw_write_fault(packet, DW_PACKET_BYTES(3u + sizeof letters), &fault));
}

static void send_frames(void)
{
    static const int16_t narrow[6] = { 1200, -340, 0, 17, INT16_MIN, INT16_MAX };
    dw_frame frame = { .count = 6, .sequence = 7, .time_us = 58333 };
    send_packet(dw_write_frame_i16(packet, sizeof packet, &frame, narrow));
    static const int32_t wide[5] = { 1200, -340, 0, INT32_MAX, INT32_MIN };
    frame = (dw_frame){ .flags = DW_SATURATED | DW_OVERRUN, .count = 5, .sequence = UINT32_MAX };
    frame.time_us = ((uint64_t)1 << 40) + 5;
    send_packet(dw_write_frame_i32(packet, sizeof packet, &frame, wide));
    int16_t test[12];
    for (uint16_t k = 0; k < 12; k++)
        test[k] = dw_test_reading(k);
    frame = (dw_frame){ .flags = DW_TEST, .count = 12, .sequence = 8, .time_us = 66667 };
    send_packet(dw_write_frame_i16(packet, sizeof packet, &frame, test));
    int16_t readings[203] = { 0 };
    for (int k = 0; k < 200; k++)
        readings[2 + k] = (int16_t)(0x0101 * (1 + k % 100));
    frame = (dw_frame){ .count = 203, .sequence = 0x01020304u, .time_us = 0x0102030405060708u };
    send_packet(dw_write_frame_i16(packet, sizeof packet, &frame, readings));
}

/* Every buffer that is too short is refused, and nothing is written behind it. */
static bool refuses_short_buffers(void)
{
    const dw_frame frame = { .count = 200, .sequence = 5 };
    static int16_t readings[200];
    for (int k = 0; k < 200; k++)
        readings[k] = (int16_t)(k % 150 == 0 ? 0 : 0x0101);
    const size_t needed = dw_write_frame_i16(packet, sizeof packet, &frame, readings);
    for (size_t room = 0; room < needed; room++) {
        memset(packet, 0xAA, sizeof packet);
        if (dw_write_frame_i16(packet, room, &frame, readings) != 0 || packet[room] != 0xAA)
            return false;
    }
    return needed > 0 && needed <= DW_PACKET_BYTES(DW_FRAME_BYTES(200u, 2u))
        && dw_write_frame_i16(packet, needed, &frame, readings) == needed;
}

static int encode(void)
{
    if (dw_crc32c((const uint8_t *)"123456789", 9) != 0xE3069283u || !refuses_short_buffers())
        return 1;
    send_commands();
    send_reports();
    send_frames();
    dw_writer writer;
    dw_begin(&writer, packet, sizeof packet);
    send_packet(dw_end(&writer));
    return 0;
}

int main(int count, char **words)
{
    if (count == 2 && strcmp(words[1], "decode") == 0)
        return decode();
    if (count == 2 && strcmp(words[1], "encode") == 0)
        return encode();
    fprintf(stderr, "usage: %s decode|encode\n", words[0]);
    return 2;
}
