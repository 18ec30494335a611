/* A small master for Modbus RTU in C: modbus_master PORT read REGISTER | PORT write REGISTER VALUE. */
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <termios.h>
#include <unistd.h>

enum { ADDRESS = 1, ATTEMPTS = 3, TIMEOUT_MS = 400, GAP_MS = 30, PAUSE_US = 8000 };

static uint16_t crc(const uint8_t *data, int size)
{
    uint16_t sum = 0xFFFF;
    for (int at = 0; at < size; at++) {
        sum ^= data[at];
        for (int bit = 0; bit < 8; bit++)
            sum = sum & 1 ? sum >> 1 ^ 0xA001 : sum >> 1;
    }
    return sum;
}

static int receive(int port, uint8_t *reply, int room)
{
    int size = 0, wait_ms = TIMEOUT_MS;
    while (size < room) {
        fd_set ports;
        struct timeval left = {0, wait_ms * 1000};
        FD_ZERO(&ports);
        FD_SET(port, &ports);
        if (select(port + 1, &ports, NULL, NULL, &left) <= 0)
            break;
        ssize_t came = read(port, reply + size, room - size);
        if (came <= 0)
            break;
        size += came;
        wait_ms = GAP_MS;
    }
    return size;
}

/* Returns the number of the sound bytes of the reply, 0 for none, -1 for a refusal. */
static int ask(int port, uint8_t *request, uint8_t *reply, int expected)
{
    uint16_t sum = crc(request, 6);
    request[6] = sum & 0xFF;
    request[7] = sum >> 8;
    for (int attempt = 0; attempt < ATTEMPTS; attempt++) {
        usleep(PAUSE_US);
        tcflush(port, TCIFLUSH);
        if (write(port, request, 8) != 8)
            return 0;
        int size = receive(port, reply, 64);
        if (size >= 5 && reply[0] == ADDRESS && crc(reply, size) == 0) {
            if (size == 5 && reply[1] == (request[1] | 0x80)) {
                fprintf(stderr, "error: refused with code %d\n", reply[2]);
                return -1;
            }
            if (size == expected && reply[1] == request[1])
                return size;
        }
    }
    fprintf(stderr, "error: no reply\n");
    return 0;
}

int main(int count, char **words)
{
    uint8_t reply[64], request[8] = {ADDRESS};
    struct termios settings;
    if (count < 4)
        return 2;
    int port = open(words[1], O_RDWR | O_NOCTTY), at = atoi(words[3]);
    if (port < 0 || tcgetattr(port, &settings))
        return 2;
    cfmakeraw(&settings);
    cfsetspeed(&settings, B9600);
    if (tcsetattr(port, TCSANOW, &settings))
        return 2;
    request[2] = at >> 8;
    request[3] = at & 0xFF;
    if (!strcmp(words[2], "read")) {
        request[1] = 3;
        request[5] = 1;
        if (ask(port, request, reply, 7) <= 0 || reply[2] != 2)
            return 1;
        printf("value %d\n", reply[3] << 8 | reply[4]);
        return 0;
    }
    int value = count > 4 ? atoi(words[4]) : 0;
    request[1] = 6;
    request[4] = value >> 8 & 0xFF;
    request[5] = value & 0xFF;
    if (ask(port, request, reply, 8) <= 0 || memcmp(request, reply, 6))
        return 1;
    printf("written\n");
    return 0;
}
