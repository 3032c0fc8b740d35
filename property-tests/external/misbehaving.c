/* A renderer that pushes the tip out along z above a height, and misbehaves as its options say. */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "stickslip_renderer.h"

#ifndef VERSION
#define VERSION STICKSLIP_RENDERER_ABI
#endif

static const char *options;
static uint64_t ticks;
static void *in_use;

static int is(const char *word) { return strcmp(options, word) == 0; }

uint32_t stickslip_renderer_abi(void) { return VERSION; }

void *stickslip_renderer_create(const stickslip_body *body, const stickslip_setup *setup) {
  options = setup->options;
  if (is("refuse")) return NULL;
  if (is("write-to-body")) ((double *)body->rest)[0] = 1.0;
  return malloc(1);
}

void *stickslip_renderer_build(void *renderer, const stickslip_state *state) {
  (void)renderer;
  if (is("no-model") && state->tick > 0) return NULL;
  if (is("no-first-model")) return NULL;
  return malloc(1);
}

#ifndef WITHOUT_SWAP
void *stickslip_renderer_swap(void *renderer, void *model) {
  (void)renderer;
  void *old = in_use;
  in_use = model;
  return old;
}
#endif

int32_t stickslip_renderer_tick(void *renderer, const double before[3], const double tip[3], stickslip_output *output) {
  (void)renderer, (void)before;
  if (++ticks == 50) {
    if (is("crash")) *(volatile int *)0 = 1;
    if (is("abort")) abort();
    if (is("exit")) exit(5);
    if (is("fault")) return 7;
    if (is("mode")) output->mode = 9;
    if (is("triangle")) output->mode = STICKSLIP_MODE_SLIDE, output->triangle = UINT32_MAX;
    if (is("nan")) output->force[0] = 0.0 / (output->force[1] * 0.0);
    if (is("beyond-output")) ((volatile char *)(output + 1))[0] = 1;
    if (is("hang"))
      for (;;) sleep(1);
  }
  output->force[2] = tip[2] < 0.001 ? 0.1 : 0.0;
  return 0;
}

uint64_t stickslip_renderer_moved(void *renderer, uint64_t capacity, uint32_t *nodes, double *x, double *v) {
  (void)renderer, (void)x, (void)v;
  if (is("too-many")) return capacity + 1;
  if (is("beyond-nodes")) nodes[capacity] = 0;
  return 0;
}

void stickslip_renderer_dispose(void *model) { free(model); }

void stickslip_renderer_destroy(void *renderer) {
  free(in_use);
  free(renderer);
}

uint64_t stickslip_renderer_message(void *renderer, char *buffer, uint64_t capacity) {
  static const char text[] = "no \033[31msuch\033[0m body";
  (void)renderer;
  memcpy(buffer, text, capacity < sizeof text - 1 ? capacity : sizeof text - 1);
  return sizeof text - 1;
}
