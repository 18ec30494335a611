/* Serial lines as pseudo-terminals, with the character times and reply delays of real ones.

   A measuring instrument: it spins on a processor core of its own and reports its lateness at the end.

   Standard input describes the lines, one fact a line of text, all times in seconds:

       line BITS BAUD DELAY_FROM DELAY_TO SEED byte|telegram
       deaf SECONDS                  for this long after its reply, the drive ignores characters
       answer REQUEST REPLY          both in hexadecimal; "-" for a telegram without a reply
       go

   BITS is the length of one character, including start, parity and stop bits. A drive answers after a delay between the
   two limits (evenly spread, from the seed). "byte": the master gets each character after its last bit; "telegram": the
   whole reply after the last bit of its last character, as from an adapter with a buffer. "answer" and "deaf" belong to
   the preceding line.

   After "go" it prints the paths of the lines as one line of JSON. Then it serves until standard input ends or SIGTERM
   arrives, and prints its observations as one line of JSON:

       lateness_us   how long after its due time each delivery was made
       stalls        number and total time of interruptions of more than 100 us
       lines         for each line: requests answered, telegrams swallowed, stretches of unknown bytes, collisions
                     (bytes sent while a reply was due or on the wire; they are lost), and gap_us: from the end of a
                     reply to the beginning, on the wire, of the next request

   Physics: a character written at t is on the wire from max(t, end of the character before). A request is complete when
   its last character has passed; the reply begins one delay later. */

#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { MOST_LINES = 512, MOST_ANSWERS = 128, LONGEST = 300 };
static const double STALL_S = 100e-6;
static const double LOOK_AT_STDIN_S = 0.01;

typedef struct {
    float *at;
    size_t count, room;
} samples;

typedef struct {
    unsigned char request[LONGEST], reply[LONGEST];
    size_t request_length, reply_length;
} answer;

typedef struct {
    int ours, theirs;
    char path[64];
    double character_s, delay_from, delay_to, deaf_s;
    unsigned long long random;
    int whole;
    answer answers[MOST_ANSWERS];
    size_t answer_count;
    /* bytes from the master that belong to no telegram yet, with the time at which each began on the wire */
    unsigned char heard[LONGEST];
    double began[LONGEST];
    size_t heard_length;
    int lost; /* inside a stretch of unknown bytes */
    double free_at;
    /* the reply that is due or on the wire */
    const answer *speaking;
    size_t spoken;
    double reply_begins, next_due, reply_ended;
    long requests, swallowed, unknown, collisions;
    samples gaps;
} line;

static line *lines[MOST_LINES];
static int line_count;
static samples lateness;
static volatile sig_atomic_t stopping;

static void stop(int signal_number) {
    (void)signal_number;
    stopping = 1;
}

static void die(const char *what) {
    fprintf(stderr, "line_emulator: %s: %s\n", what, errno ? strerror(errno) : "wrong description");
    exit(2);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static void note(samples *all, double seconds) {
    if (all->count == all->room) {
        all->room = all->room ? 2 * all->room : 4096;
        all->at = realloc(all->at, all->room * sizeof *all->at);
        if (!all->at) die("memory");
    }
    all->at[all->count++] = (float)(seconds * 1e6);
}

static int ascending(const void *left, const void *right) {
    float a = *(const float *)left, b = *(const float *)right;
    return (a > b) - (a < b);
}

static void print_samples(samples *all) {
    if (!all->count) {
        printf("{\"count\": 0}");
        return;
    }
    qsort(all->at, all->count, sizeof *all->at, ascending);
    printf("{\"count\": %zu, \"min\": %.1f, \"p50\": %.1f, \"p99\": %.1f, \"max\": %.1f}", all->count, all->at[0],
           all->at[all->count / 2], all->at[(size_t)((double)(all->count - 1) * 0.99)], all->at[all->count - 1]);
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

static void open_line(line *one) {
    struct termios raw;
    const char *name;
    one->ours = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (one->ours < 0 || grantpt(one->ours) || unlockpt(one->ours) || !(name = ptsname(one->ours)))
        die("pseudo-terminal");
    snprintf(one->path, sizeof one->path, "%s", name);
    /* held open, so that masters can connect repeatedly */
    one->theirs = open(one->path, O_RDWR | O_NOCTTY);
    if (one->theirs < 0 || tcgetattr(one->theirs, &raw)) die(one->path);
    cfmakeraw(&raw);
    if (tcsetattr(one->theirs, TCSANOW, &raw)) die(one->path);
}

static void read_description(void) {
    char word[16], first[2 * LONGEST + 1], second[2 * LONGEST + 1];
    while (scanf("%15s", word) == 1) {
        if (!strcmp(word, "go")) return;
        if (!strcmp(word, "line")) {
            double bits, baud;
            line *one = calloc(1, sizeof *one);
            if (!one || line_count == MOST_LINES) die("too many lines");
            if (scanf("%lf %lf %lf %lf %llu %15s", &bits, &baud, &one->delay_from, &one->delay_to, &one->random, word) != 6)
                die("line");
            one->character_s = bits / baud;
            one->whole = !strcmp(word, "telegram");
            one->random = one->random * 2862933555777941757ULL + 3037000493ULL;
            open_line(one);
            lines[line_count++] = one;
        } else if (!strcmp(word, "deaf") && line_count) {
            if (scanf("%lf", &lines[line_count - 1]->deaf_s) != 1) die("deaf");
        } else if (!strcmp(word, "answer") && line_count) {
            line *one = lines[line_count - 1];
            answer *known = &one->answers[one->answer_count++];
            if (one->answer_count > MOST_ANSWERS || scanf("%600s %600s", first, second) != 2) die("answer");
            known->request_length = from_hex(first, known->request);
            known->reply_length = from_hex(second, known->reply);
        } else {
            die(word);
        }
    }
    die("no go");
}

static double delay(line *one) {
    one->random ^= one->random << 13;
    one->random ^= one->random >> 7;
    one->random ^= one->random << 17;
    return one->delay_from + (one->delay_to - one->delay_from) * ((double)(one->random >> 11) / 9007199254740992.0);
}

static void forget(line *one, size_t count) {
    one->heard_length -= count;
    memmove(one->heard, one->heard + count, one->heard_length);
    memmove(one->began, one->began + count, one->heard_length * sizeof *one->began);
}

/* Extract telegrams from the received bytes, the longest match first. A possible prefix of a longer one waits. */
static void understand(line *one) {
    while (one->heard_length && !one->speaking) {
        const answer *fits = NULL;
        int may_grow = 0;
        for (size_t i = 0; i < one->answer_count; i++) {
            const answer *known = &one->answers[i];
            size_t common = known->request_length < one->heard_length ? known->request_length : one->heard_length;
            if (memcmp(known->request, one->heard, common)) continue;
            if (known->request_length > one->heard_length)
                may_grow = 1;
            else if (!fits || known->request_length > fits->request_length)
                fits = known;
        }
        if (may_grow) return;
        if (!fits) {
            one->unknown += !one->lost;
            one->lost = 1;
            forget(one, 1);
            continue;
        }
        one->lost = 0;
        if (!fits->reply_length) {
            one->swallowed++;
            forget(one, fits->request_length);
            continue;
        }
        one->requests++;
        if (one->reply_ended > 0) note(&one->gaps, one->began[0] - one->reply_ended);
        one->reply_begins = one->began[fits->request_length - 1] + one->character_s + delay(one);
        one->speaking = fits;
        one->spoken = 0;
        one->reply_ended = one->reply_begins + (double)fits->reply_length * one->character_s;
        one->next_due = one->whole ? one->reply_ended : one->reply_begins + one->character_s;
        forget(one, fits->request_length);
        if (one->heard_length) {
            one->collisions++;
            one->heard_length = 0;
        }
    }
}

static void hear(line *one) {
    unsigned char came[LONGEST];
    ssize_t count = read(one->ours, came, sizeof came);
    double at = now();
    if (count <= 0) return;
    if (one->speaking) {
        one->collisions++;
        return;
    }
    for (ssize_t i = 0; i < count; i++) {
        if (one->heard_length == LONGEST) forget(one, 1);
        one->began[one->heard_length] = one->free_at > at ? one->free_at : at;
        one->free_at = one->began[one->heard_length] + one->character_s;
        if (one->began[one->heard_length] < one->reply_ended + one->deaf_s) continue;
        one->heard[one->heard_length++] = came[i];
    }
    understand(one);
}

static void speak(line *one) {
    size_t count = one->whole ? one->speaking->reply_length : 1;
    ssize_t taken = write(one->ours, one->speaking->reply + one->spoken, count);
    note(&lateness, now() - one->next_due);
    if (taken != (ssize_t)count) die("a master does not read");
    one->spoken += count;
    one->next_due += one->character_s;
    if (one->spoken == one->speaking->reply_length) {
        one->free_at = one->reply_ended;
        one->speaking = NULL;
    }
}

static void report(long stalls, double stalled_s) {
    printf("{\"lateness_us\": ");
    print_samples(&lateness);
    printf(", \"stalls\": %ld, \"stalled_s\": %.6f, \"lines\": [", stalls, stalled_s);
    for (int i = 0; i < line_count; i++) {
        line *one = lines[i];
        printf("%s{\"requests\": %ld, \"swallowed\": %ld, \"unknown\": %ld, \"collisions\": %ld, \"gap_us\": ",
               i ? ", " : "", one->requests, one->swallowed, one->unknown, one->collisions);
        print_samples(&one->gaps);
        printf("}");
    }
    printf("]}\n");
}

int main(void) {
    struct sigaction ending = {.sa_handler = stop};
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    struct epoll_event ready[MOST_LINES];
    double before, look_at;
    long stalls = 0;
    double stalled_s = 0;
    int set = epoll_create1(0);

    sigaction(SIGTERM, &ending, NULL);
    /* Unbuffered, so that poll sees the input after "go". */
    setvbuf(stdin, NULL, _IONBF, 0);
    read_description();
    printf("[");
    for (int i = 0; i < line_count; i++) {
        struct epoll_event wanted = {.events = EPOLLIN, .data.u32 = (unsigned)i};
        if (epoll_ctl(set, EPOLL_CTL_ADD, lines[i]->ours, &wanted)) die("epoll");
        printf("%s\"%s\"", i ? ", " : "", lines[i]->path);
    }
    printf("]\n");
    fflush(stdout);
    before = now();
    look_at = before;
    while (!stopping) {
        double at = now();
        if (at - before > STALL_S) {
            stalls++;
            stalled_s += at - before;
        }
        before = at;
        int count = epoll_wait(set, ready, MOST_LINES, 0);
        for (int i = 0; i < count; i++) hear(lines[ready[i].data.u32]);
        at = now();
        for (int i = 0; i < line_count; i++)
            if (lines[i]->speaking && lines[i]->next_due <= at) speak(lines[i]);
        if (at >= look_at) {
            char rest[16];
            look_at = at + LOOK_AT_STDIN_S;
            if (poll(&input, 1, 0) > 0 && read(STDIN_FILENO, rest, sizeof rest) <= 0) break;
        }
    }
    report(stalls, stalled_s);
    return 0;
}
