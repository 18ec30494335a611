/* Bare master as the reference for the framework: poll, read, compare, and nothing else.

   Standard input describes the lines, one fact a line of text, times in seconds:

       line PATH PAUSE byte|reply
       ask REQUEST REPLY CLOSING      in hexadecimal; "-" for no closing telegram
       run SECONDS

   It repeats the request on all lines concurrently for this many seconds. It keeps PAUSE from the end of a reply to its
   next byte: the closing telegram, if any, with the next request directly after it. "byte": poll wakes for every
   character; "reply": only for a whole reply (VMIN). "ask" belongs to the preceding line.

   Prints one line of JSON: exchanges and seconds of each line, wrong replies, and processor time of the whole. The
   first exchange of a line is not counted: the time runs from the end of its reply to the end of the last reply. */

#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { MOST_LINES = 256, LONGEST = 300 };
/* A sleep ends some microseconds late, so the last part of a pause is a busy wait. */
static const double SPIN_S = 40e-6;
static const double LOST_S = 1.0;

typedef struct {
    int port;
    double pause_s;
    unsigned char request[2 * LONGEST], reply[LONGEST], came[LONGEST];
    size_t closing_length, request_length, reply_length, came_length;
    double asked_at, due; /* due: when the next request may go; 0 while a reply is awaited */
    double began, ended; /* began: 0 before the first reply */
    long exchanges, wrong;
} line;

static line *lines[MOST_LINES];
static struct pollfd ports[MOST_LINES];
static int line_count;
static double seconds;

static void die(const char *what) {
    fprintf(stderr, "reference_client: %s: %s\n", what, errno ? strerror(errno) : "wrong description");
    exit(2);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static size_t from_hex(const char *text, unsigned char *into) {
    size_t length = strlen(text) / 2;
    if (!strcmp(text, "-")) return 0;
    if (strlen(text) % 2 || length > LONGEST) die("hexadecimal text");
    for (size_t i = 0; i < length; i++) {
        unsigned byte;
        if (sscanf(text + 2 * i, "%2x", &byte) != 1) die("hexadecimal text");
        into[i] = (unsigned char)byte;
    }
    return length;
}

static void open_port(line *one, const char *path, cc_t wake_for) {
    struct termios raw;
    one->port = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (one->port < 0 || tcgetattr(one->port, &raw)) die(path);
    cfmakeraw(&raw);
    raw.c_cc[VMIN] = wake_for;
    raw.c_cc[VTIME] = 0;
    if (tcsetattr(one->port, TCSANOW, &raw)) die(path);
}

static void read_description(void) {
    char word[16], path[256], wake[16] = "", request[2 * LONGEST + 1], reply[2 * LONGEST + 1], closing[2 * LONGEST + 1];
    while (scanf("%15s", word) == 1) {
        if (!strcmp(word, "run")) {
            if (scanf("%lf", &seconds) != 1) die("run");
            return;
        }
        if (!strcmp(word, "line")) {
            line *one = calloc(1, sizeof *one);
            if (!one || line_count == MOST_LINES) die("too many lines");
            if (scanf("%255s %lf %15s", path, &one->pause_s, wake) != 3) die("line");
            lines[line_count++] = one;
        } else if (!strcmp(word, "ask") && line_count) {
            line *one = lines[line_count - 1];
            if (scanf("%600s %600s %600s", request, reply, closing) != 3) die("ask");
            one->closing_length = from_hex(closing, one->request);
            one->request_length = from_hex(request, one->request + one->closing_length);
            one->reply_length = from_hex(reply, one->reply);
            open_port(one, path, !strcmp(wake, "reply") && one->reply_length < 256 ? (cc_t)one->reply_length : 1);
        } else {
            die(word);
        }
    }
    die("no run");
}

static void ask(line *one, double at) {
    /* The first request has no exchange before it to close. */
    size_t from = one->began > 0 ? 0 : one->closing_length;
    size_t length = one->closing_length + one->request_length - from;
    one->due = 0;
    one->came_length = 0;
    one->asked_at = at;
    if (write(one->port, one->request + from, length) != (ssize_t)length) die("write");
}

static void hear(line *one) {
    ssize_t count = read(one->port, one->came + one->came_length, LONGEST - one->came_length);
    if (count <= 0) {
        if (count < 0 && (errno == EAGAIN || errno == EINTR)) return;
        die("read");
    }
    one->came_length += (size_t)count;
    if (one->came_length < one->reply_length) return;
    one->ended = now();
    if (one->came_length != one->reply_length || memcmp(one->came, one->reply, one->reply_length))
        one->wrong++;
    else if (one->began > 0)
        one->exchanges++;
    if (!(one->began > 0)) one->began = one->ended;
    if (one->pause_s > 0)
        one->due = one->ended + one->pause_s;
    else
        ask(one, one->ended);
}

int main(void) {
    struct rusage before, after;
    double end, at;

    prctl(PR_SET_TIMERSLACK, 1000UL);
    read_description();
    for (int i = 0; i < line_count; i++) {
        ports[i].fd = lines[i]->port;
        ports[i].events = POLLIN;
    }
    getrusage(RUSAGE_SELF, &before);
    at = now();
    end = at + seconds;
    for (int i = 0; i < line_count; i++) ask(lines[i], at);
    while ((at = now()) < end) {
        double nearest = end;
        for (int i = 0; i < line_count; i++) {
            line *one = lines[i];
            if (one->due && one->due <= at) ask(one, at);
            if (one->due && one->due < nearest) nearest = one->due;
            if (!one->due && at - one->asked_at > LOST_S) die("no reply");
        }
        double left = nearest - at - SPIN_S;
        struct timespec wait = {0, 0};
        if (left > 0) {
            wait.tv_sec = (time_t)left;
            wait.tv_nsec = (long)((left - (double)wait.tv_sec) * 1e9);
        }
        if (ppoll(ports, (nfds_t)line_count, &wait, NULL) <= 0) continue;
        for (int i = 0; i < line_count; i++)
            if (ports[i].revents) hear(lines[i]);
    }
    getrusage(RUSAGE_SELF, &after);
    double processor = (double)(after.ru_utime.tv_sec - before.ru_utime.tv_sec) +
                       (double)(after.ru_stime.tv_sec - before.ru_stime.tv_sec) +
                       (double)(after.ru_utime.tv_usec - before.ru_utime.tv_usec) * 1e-6 +
                       (double)(after.ru_stime.tv_usec - before.ru_stime.tv_usec) * 1e-6;
    long wrong = 0;
    printf("{\"lines\": [");
    for (int i = 0; i < line_count; i++) {
        wrong += lines[i]->wrong;
        printf("%s{\"exchanges\": %ld, \"seconds\": %.9f}", i ? ", " : "", lines[i]->exchanges,
               lines[i]->ended - lines[i]->began);
    }
    printf("], \"wrong\": %ld, \"processor_s\": %.6f}\n", wrong, processor);
    return 0;
}
