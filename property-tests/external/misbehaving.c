/* A renderer that pushes the tip up below a height, and misbehaves as its options say. */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "stickslip_renderer.h"

#ifndef VERSION
#define VERSION STICKSLIP_RENDERER_ABI
#endif

struct renderer {
  const char *options;
  uint64_t nodes, ticks;
  /* A model is the sum of all heights, m, so that a force can tell how the network has moved. */
  double *in_use;
};

static int is(const struct renderer *self, const char *word) { return strcmp(self->options, word) == 0; }

uint32_t stickslip_renderer_abi(void) { return VERSION; }

void *stickslip_renderer_create(const stickslip_body *body, const stickslip_setup *setup) {
  struct renderer *self = calloc(1, sizeof *self);
  self->options = setup->options;
  self->nodes = body->nodes;
  if (is(self, "write-to-body")) ((double *)body->rest)[0] = 1.0;
  if (is(self, "refuse")) {
    free(self);
    return NULL;
  }
  return self;
}

void *stickslip_renderer_build(void *renderer, const stickslip_state *state) {
  struct renderer *self = renderer;
  if (is(self, "no-model") && state->tick > 0) return NULL;
  if (is(self, "no-first-model")) return NULL;
  double *model = calloc(1, sizeof *model);
  for (uint64_t i = 0; i < self->nodes; i++) *model += state->x[3 * i + 2];
  return model;
}

#ifndef WITHOUT_SWAP
void *stickslip_renderer_swap(void *renderer, void *model) {
  struct renderer *self = renderer;
  void *old = self->in_use;
  self->in_use = model;
  return old;
}
#endif

int32_t stickslip_renderer_tick(void *renderer, const double before[3], const double tip[3], stickslip_output *output) {
  struct renderer *self = renderer;
  (void)before;
  if (++self->ticks == 50) {
    if (is(self, "crash")) *(volatile int *)0 = 1;
    if (is(self, "abort")) abort();
    if (is(self, "exit")) exit(5);
    if (is(self, "fault")) return 7;
    if (is(self, "mode")) output->mode = 9;
    if (is(self, "triangle")) output->mode = STICKSLIP_MODE_SLIDE, output->triangle = UINT32_MAX;
    if (is(self, "nan")) output->force[0] = 0.0 / (output->force[1] * 0.0);
    if (is(self, "beyond-output")) ((volatile char *)(output + 1))[0] = 1;
    if (is(self, "hang"))
      for (;;) sleep(1);
  }
  output->force[2] = tip[2] < 0.001 ? 0.1 : 0.0;
  if (is(self, "push") && tip[2] < 0.0) {
    output->mode = STICKSLIP_MODE_SLIDE;
    output->weights[0] = output->normal[2] = 1.0;
    output->force[2] -= *self->in_use;
  }
  return 0;
}

#ifndef WITHOUT_MOVED
uint64_t stickslip_renderer_moved(void *renderer, uint64_t capacity, uint32_t *nodes, double *x, double *v) {
  struct renderer *self = renderer;
  (void)x, (void)v;
  if (is(self, "too-many")) return capacity + 1;
  if (is(self, "beyond-nodes")) nodes[capacity] = 0;
  return 0;
}
#endif

void stickslip_renderer_dispose(void *model) { free(model); }

void stickslip_renderer_destroy(void *renderer) {
  struct renderer *self = renderer;
  free(self->in_use);
  free(self);
}

uint64_t stickslip_renderer_message(void *renderer, char *buffer, uint64_t capacity) {
  static const char text[] = "no \033[31msuch\033[0m body";
  (void)renderer;
  memcpy(buffer, text, capacity < sizeof text - 1 ? capacity : sizeof text - 1);
  return sizeof text - 1;
}
