/* Asks a node with records, a thousand times a second: cc node_client.c -o ask && ./ask PORT [COUNT] */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

/* Little-endian, as this processor has to be; there are no gaps between these. */
struct question { char mark[4]; uint32_t drive, sequence, waypoints; double executed, dt, time, lateral_error,
    heading_error, v_x, v_y, yaw_rate, steer, curvature, spacing, preview[15][2]; };
struct answer { char mark[4]; uint32_t drive, sequence; uint16_t status, late; double steer; };

int main(int count, char **words)
{
    const struct timespec pause = {0, 1000000}, *const p = &pause;
    struct sockaddr_in node = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct question seen = {"", 0, 0, 15, 0.0, 0.0, 0.0, 0.1, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 2.0, {{0.0}}};
    struct answer answer = {.status = 255};
    const int asked = count > 2 ? atoi(words[2]) : 1000, line = socket(AF_INET, SOCK_DGRAM, 0);
    const struct timeval patience = {1, 0};
    const int port = count > 1 ? atoi(words[1]) : 0;
    int i;

    if (count > 3 || port < 1 || port > 65535 || asked < 1) {
        return fprintf(stderr, "ask: give the port of a node, and how often to ask: PORT [COUNT]\n"), 2;
    }
    node.sin_port = htons((uint16_t)port);
    setsockopt(line, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    memcpy(seen.mark, "\x02SQ1", 4);
    for (i = 0; i < 15; ++i) {
        seen.preview[i][0] = 2.0 * i; /* the car is 0.1 m left of a straight road */
        seen.preview[i][1] = -0.1;
    }
    for (i = 0; i < asked; ++i, nanosleep(p, NULL)) {
        seen.sequence = (uint32_t)i;
        seen.time = 0.001 * i;
        seen.executed = seen.steer = answer.status == 255 ? 0.0 : answer.steer; /* NAN: as answered */
        if (connect(line, (struct sockaddr *)&node, sizeof node) || send(line, &seen, sizeof seen, 0) < 0
            || recv(line, &answer, sizeof answer, 0) != (ssize_t)sizeof answer || answer.sequence != (uint32_t)i) {
            return fprintf(stderr, "ask: no node answers on port %d\n", port), 2;
        }
    }
    printf("%d answers; status %d, steer %.17g\n", asked, answer.status, answer.steer);
    return close(line);
}
