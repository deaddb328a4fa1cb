/* Steers by lines of JSON, as controller=process asks, with the C of a controller that was exported under the name
 * "steering": cc -I FOLDER steer.c FOLDER/steersman_steering.c -lm -o steer */
#include "steersman_steering.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* double; float in an export with --precision single or mixed. */
typedef steersman_steering_number real;

/* The number at or after a place of the line, and the place after it; NAN if there is none (null). */
static real number(const char **at)
{
    char *end = NULL;
    const real value = (real)(*at == NULL ? NAN : strtod(*at, &end));

    *at = end == NULL || end == *at ? NULL : end;
    return *at == NULL ? (real)NAN : value;
}

/* The place after a name; NULL if it is not there. */
static const char *after(const char *line, const char *name)
{
    const char *const at = strstr(line, name);

    return at == NULL ? NULL : at + strlen(name);
}

static real named(const char *line, const char *name)
{
    const char *at = after(line, name);

    return number(&at);
}

int main(void)
{
    static char line[100000];
    static steersman_steering_state state;
    steersman_steering_observation seen;
    real drive = -1;
    real steer = 0;
    int i;

    while (fgets(line, sizeof line, stdin) != NULL) {
        const real executed = named(line, "\"executed\":");
        const char *at = after(line, "\"preview\":");

        if (named(line, "\"drive\":") != drive) { /* another one begins */
            drive = named(line, "\"drive\":");
            steersman_steering_init(&state, NULL);
        } else if (isfinite(executed)) {
            steersman_steering_executed(&state, executed);
        }
        seen.time = named(line, "\"time\":");
        seen.lateral_error = named(line, "\"lateral_error\":");
        seen.heading_error = named(line, "\"heading_error\":");
        seen.v_x = named(line, "\"v_x\":");
        seen.v_y = named(line, "\"v_y\":");
        seen.yaw_rate = named(line, "\"yaw_rate\":");
        seen.steer = named(line, "\"steer\":");
        seen.curvature = named(line, "\"curvature\":");
        for (i = 0; i < 2 * STEERSMAN_STEERING_WAYPOINTS; ++i) {
            at = at == NULL ? NULL : at + strspn(at, "[], ");
            seen.preview[i / 2][i % 2] = number(&at);
        }
        (void)steersman_steering_step(&state, &seen, &steer);
        printf("{\"steer\": %.17g}\n", (double)steer);
        fflush(stdout);
    }
    return 0;
}
