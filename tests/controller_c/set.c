/* Sets the params of the exported task "touch-live" between its steps, as a host does.
 *
 * Samples come from standard input, answers go to standard output: torques, state, value of push.
 * What the setter says of values that are none of a param is checked by the exit code. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "touch_live.h"

static double memory[TOUCH_LIVE_SIZE / sizeof(double)];
static struct touch_live *task;

static int wrong(void)
{
    const struct touch_live_param_facts *facts = touch_live_params();
    int push = touch_live_param_push;
    if (TOUCH_LIVE_PARAMS != 2 || strcmp(facts[push].name, "push") != 0) return 11;
    if (strcmp(facts[push].unit, "N") != 0 || facts[push].value != 5.0) return 12;
    if (facts[push].low != 2.0 || facts[push].high != 8.0 || facts[push].rate != 20.0) return 13;
    if (facts[touch_live_param_sway].rate != 0.0) return 14;
    if (touch_live_get(task, push) != 5.0) return 15;
    /* The nearest in the range; what is no number changes nothing. */
    if (touch_live_set(task, push, INFINITY) != 8.0) return 16;
    if (touch_live_set(task, push, NAN) != 8.0 || touch_live_get(task, push) != 8.0) return 17;
    if (touch_live_set(task, push, -1.0) != 2.0 || touch_live_get(task, push) != 2.0) return 18;
    if (!isnan(touch_live_set(task, 2, 5.0)) || !isnan(touch_live_get(task, -1))) return 19;
    return 0;
}

int main(void)
{
    struct touch_live_input in;
    struct touch_live_output out;
    double answer[TOUCH_LIVE_JOINTS + 2];
    int tick = 0, code;
    task = touch_live_init(memory);
    code = wrong();
    if (code) return code;
    /* Begun with 2 N, and begun anew with those of the file. */
    memset(&in, 0, sizeof in);
    touch_live_start(task, &in, &out);
    if (touch_live_get(task, touch_live_param_push) != 2.0) return 20;
    while (fread(&in, sizeof in, 1, stdin) == 1) {
        if (tick == 0) {
            touch_live_start(task, &in, &out);
            if (touch_live_get(task, touch_live_param_push) != 5.0) return 21;
            touch_live_set(task, touch_live_param_push, 4.0);
            touch_live_set(task, touch_live_param_sway, 0.003);
        }
        if (tick == 31) touch_live_set(task, touch_live_param_sway, 0.007);
        if (tick == 200) touch_live_set(task, touch_live_param_push, 8.0);
        if (tick >= 250) touch_live_set(task, touch_live_param_push, 3.0);
        touch_live_step(task, &in, &out);
        memcpy(answer, out.torque, sizeof out.torque);
        answer[TOUCH_LIVE_JOINTS] = out.state;
        answer[TOUCH_LIVE_JOINTS + 1] = touch_live_get(task, touch_live_param_push);
        fwrite(answer, sizeof(double), TOUCH_LIVE_JOINTS + 2, stdout);
        tick++;
    }
    return 0;
}
