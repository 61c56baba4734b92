/* SPDX-License-Identifier: BSD-3-Clause */
/* Initializer and odometry from C11. Images are the shifted texture of a wall that stands at depth 1 behind a nearer
   floor; what is checked is the interface, not the accuracy. */
#include <dsorb/c/dsorb.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { kWidth = 320, kHeight = 240, kFrames = 30, kHurried = 8, kErrorSize = 200 };
static const double kFocal = 250;

#define CHECK(condition)                                                          \
  do {                                                                            \
    if (!(condition)) {                                                           \
      printf("line %d: %s; last error: %s\n", __LINE__, #condition, error);      \
      return 1;                                                                   \
    }                                                                             \
  } while (0)

static double value(long x, long y) {
  unsigned h = (unsigned)x * 374761393U + (unsigned)y * 668265263U;
  h = (h ^ (h >> 13U)) * 1274126177U;
  return (double)((h ^ (h >> 16U)) & 0xFFFFU) / 65535.0;
}

static double noise(double u, double v) {
  const double x = floor(u), y = floor(v), a = u - x, b = v - y;
  const double sa = a * a * (3 - 2 * a), sb = b * b * (3 - 2 * b);
  const long i = (long)x, j = (long)y;
  return (1 - sb) * ((1 - sa) * value(i, j) + sa * value(i + 1, j)) +
         sb * ((1 - sa) * value(i, j + 1) + sa * value(i + 1, j + 1));
}

/* A corridor seen by a camera that moves to the right; `readout` is the share of the time between two images that the
   rows take. */
static void render(int index, double readout, uint8_t* image) {
  for (int row = 0; row < kHeight; ++row) {
    const double moved = 0.04 * (index + readout * ((double)row / (kHeight - 1) - 0.5));
    for (int column = 0; column < kWidth; ++column) {
      const double x = (column - kWidth / 2) / kFocal, y = (row - kHeight / 2) / kFocal;
      const double wall = 6, floor_depth = y > 1e-6 ? 1.2 / y : 1e9;
      const double depth = floor_depth < wall ? floor_depth : wall;
      const double s = x * depth + moved, t = floor_depth < wall ? depth + 40 : y * depth;
      const double grey = 0.6 * noise(4 * s, 4 * t) + 0.4 * noise(11 * s + 50, 11 * t);
      image[row * kWidth + column] = (uint8_t)(20 + 215 * grey);
    }
  }
}

static dsorb_image imageOf(int index, uint8_t* pixels) {
  const dsorb_image image = {pixels, 0, index, index / 30.0, 0, NULL, NULL, 0};
  render(index, 0, pixels);
  return image;
}

static int checkErrors(const dsorb_camera* camera) {
  char error[kErrorSize] = "";
  char tiny[6] = "xxxxx";
  dsorb_initializer* initializer = NULL;
  dsorb_state state;
  CHECK(dsorb_initializer_create("no-such", camera, 1, &initializer, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(initializer == NULL && strstr(error, "no-such") != NULL && strstr(error, "coarse") != NULL);
  CHECK(dsorb_initializer_create("no-such", camera, 1, &initializer, tiny, sizeof tiny) == DSORB_BAD_ARGUMENT);
  CHECK(strlen(tiny) == 5);
  CHECK(dsorb_initializer_create("orb", NULL, 1, &initializer, NULL, 0) == DSORB_BAD_ARGUMENT);
  CHECK(dsorb_initializer_create("orb", camera, 1, NULL, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(dsorb_initializer_create(NULL, camera, 1, &initializer, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(dsorb_initializer_add(NULL, NULL, &state, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(dsorb_odometry_add(NULL, NULL, NULL, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(dsorb_initializer_frames(NULL, NULL, 0) == 0 && dsorb_odometry_points(NULL, NULL, 0) == 0);
  dsorb_initializer_set_hurried(NULL, 1);
  dsorb_odometry_set_hurried(NULL, 1);
  dsorb_initializer_destroy(NULL);
  dsorb_odometry_destroy(NULL);
  return 0;
}

static int checkInitializer(const dsorb_camera* camera, uint8_t* pixels) {
  char error[kErrorSize] = "";
  dsorb_initializer* initializer = NULL;
  dsorb_state state = DSORB_INITIALIZING;
  CHECK(dsorb_initializer_create("orb", camera, 1, &initializer, error, sizeof error) == DSORB_OK);
  dsorb_image image = imageOf(0, pixels);
  image.stride = 3;
  CHECK(dsorb_initializer_add(initializer, &image, &state, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(strstr(error, "stride") != NULL);
  image = imageOf(-1, pixels);
  CHECK(dsorb_initializer_add(initializer, &image, &state, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(strstr(error, "below 0") != NULL);
  for (int i = 0; i < kFrames && state != DSORB_INITIALIZED; ++i) {
    dsorb_initializer_set_hurried(initializer, i < kHurried);
    image = imageOf(i, pixels);
    CHECK(dsorb_initializer_add(initializer, &image, &state, error, sizeof error) == DSORB_OK);
    CHECK(i >= kHurried || state == DSORB_INITIALIZING);
  }
  CHECK(state == DSORB_INITIALIZED);
  image = imageOf(kFrames, pixels);
  CHECK(dsorb_initializer_add(initializer, &image, &state, error, sizeof error) == DSORB_WRONG_STATE);

  const size_t frames = dsorb_initializer_frames(initializer, NULL, 0);
  const size_t points = dsorb_initializer_points(initializer, NULL, 0);
  CHECK(frames >= 2 && points >= 60);
  dsorb_frame* frame = malloc(frames * sizeof *frame);
  dsorb_point* point = malloc(points * sizeof *point);
  CHECK(frame != NULL && point != NULL);
  CHECK(dsorb_initializer_frames(initializer, frame, frames) == frames);
  CHECK(dsorb_initializer_points(initializer, point, points) == points);
  CHECK(frame[0].posed && frame[0].cam_from_ref[0] == 1 && frame[0].cam_from_ref[3] == 0);
  const double* t = frame[frames - 1].cam_from_ref;
  CHECK(-t[3] > 10 * fabs(t[7]) && -t[3] > 10 * fabs(t[11])); /* to the right */
  double sum = 0;
  size_t in_reference = 0;
  for (size_t i = 0; i < points; ++i) {
    CHECK(point[i].inverse_depth > 0 && point[i].variance > 0 && (size_t)point[i].host < frames);
    if (point[i].host == 0) sum += point[i].inverse_depth, ++in_reference;
  }
  CHECK(fabs(sum / (double)in_reference - 1) < 1e-3); /* the unit */
  free(frame);
  free(point);
  CHECK(dsorb_initializer_reset(initializer, error, sizeof error) == DSORB_OK);
  CHECK(dsorb_initializer_frames(initializer, NULL, 0) == 0);
  dsorb_initializer_destroy(initializer);
  return 0;
}

static int checkOdometry(const dsorb_camera* camera, uint8_t* pixels) {
  char error[kErrorSize] = "";
  dsorb_odometry* odometry = NULL;
  dsorb_estimate estimate;
  int tracked = 0;
  CHECK(dsorb_odometry_create("orb", camera, 1, &odometry, error, sizeof error) == DSORB_OK);
  for (int i = 0; i < kFrames; ++i) {
    const dsorb_image image = imageOf(i, pixels);
    CHECK(dsorb_odometry_add(odometry, &image, &estimate, error, sizeof error) == DSORB_OK);
    CHECK(estimate.state != DSORB_LOST);
    if (estimate.state == DSORB_TRACKED) ++tracked;
  }
  CHECK(tracked >= 5 && estimate.has_pose && estimate.world_from_cam[3] > 0);
  CHECK(estimate.keyframe >= 0 && estimate.keyframe < kFrames && estimate.has_covariance);
  for (int i = 0; i < 6; ++i) CHECK(estimate.covariance[7 * i] > 0);
  CHECK(estimate.has_world_covariance);
  for (int i = 0; i < 6; ++i) CHECK(estimate.world_covariance[7 * i] > 0);
  CHECK(dsorb_odometry_points(odometry, NULL, 0) > 0);
  CHECK(dsorb_odometry_restart(odometry, error, sizeof error) == DSORB_OK);
  CHECK(dsorb_odometry_points(odometry, NULL, 0) == 0);
  dsorb_odometry_destroy(odometry);
  printf("dsorb %s from C: %d frames tracked\n", dsorb_version(), tracked);
  return 0;
}

/* Distances, rotations and depths: in metres, and wrong ones are answered. */
static int checkPriors(const dsorb_camera* camera, uint8_t* pixels) {
  char error[kErrorSize] = "";
  dsorb_odometry* odometry = NULL;
  dsorb_initializer* initializer = NULL;
  dsorb_state state = DSORB_INITIALIZING;
  dsorb_estimate estimate;
  double metres = 0, sigma = 0;
  CHECK(dsorb_odometry_create("orb", camera, 1, &odometry, error, sizeof error) == DSORB_OK);
  CHECK(dsorb_initializer_create("orb", camera, 1, &initializer, error, sizeof error) == DSORB_OK);
  dsorb_priors priors;
  memset(&priors, 0, sizeof priors);
  priors.motion = DSORB_POSE;
  for (int i = 0; i < 3; ++i) priors.cam_from_since[5 * i] = 1;
  priors.cam_from_since[3] = -0.04; /* to the right */
  for (int i = 0; i < 6; ++i) priors.motion_covariance[7 * i] = i < 3 ? 4e-6 : 1e-6;
  for (int i = 0; i < kFrames; ++i) {
    dsorb_image image = imageOf(i, pixels);
    priors.motion_since = i - 1;
    if (i > 0) image.priors = &priors;
    CHECK(dsorb_odometry_add(odometry, &image, &estimate, error, sizeof error) == DSORB_OK);
    if (state == DSORB_INITIALIZED) continue;
    CHECK(dsorb_initializer_add(initializer, &image, &state, error, sizeof error) == DSORB_OK);
    if (state != DSORB_INITIALIZED) continue;
    CHECK(dsorb_initializer_metric(initializer, &metres, &sigma) == 1);
    CHECK(metres > 0 && sigma > 0 && sigma < 0.1);
  }
  CHECK(state == DSORB_INITIALIZED && estimate.has_pose && estimate.is_metric);
  CHECK(fabs(estimate.world_from_cam[3] / (0.04 * (kFrames - 1)) - 1) < 0.1); /* metres */
  dsorb_image image = imageOf(kFrames, pixels);
  image.priors = &priors;
  priors.motion_covariance[0] = -1;
  CHECK(dsorb_odometry_add(odometry, &image, &estimate, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(strstr(error, "covariance") != NULL);
  priors.motion = DSORB_NO_MOTION;
  const dsorb_depth sample = {10, 10, 2, 0}; /* no deviation */
  priors.samples = &sample;
  priors.sample_count = 1;
  CHECK(dsorb_odometry_add(odometry, &image, &estimate, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(strstr(error, "sigma") != NULL);
  dsorb_initializer_destroy(initializer);
  dsorb_odometry_destroy(odometry);
  return 0;
}

/* Rows that are read one after the other: with the readout given, and wrong ones are answered. */
static int checkReadout(const dsorb_camera* global, uint8_t* pixels) {
  char error[kErrorSize] = "";
  dsorb_initializer* initializer[2] = {NULL, NULL};
  double sideways[2];
  dsorb_camera rolling = *global;
  rolling.readout_ms = NAN;
  CHECK(dsorb_initializer_create("orb", &rolling, 1, initializer, error, sizeof error) == DSORB_BAD_ARGUMENT);
  CHECK(strstr(error, "readout_ms") != NULL);
  rolling.readout_ms = 30;
  for (int k = 0; k < 2; ++k) {
    const dsorb_camera* camera = k == 0 ? global : &rolling;
    dsorb_state state = DSORB_INITIALIZING;
    CHECK(dsorb_initializer_create("orb", camera, 1, &initializer[k], error, sizeof error) == DSORB_OK);
    CHECK(dsorb_initializer_wrong_probability(initializer[k]) == 1);
    for (int i = 0; i < kFrames && state != DSORB_INITIALIZED; ++i) {
      dsorb_image image = imageOf(i, pixels);
      render(i, 30 * 1e-3 * rolling.readout_ms, pixels);
      CHECK(dsorb_initializer_add(initializer[k], &image, &state, error, sizeof error) == DSORB_OK);
    }
    CHECK(state == DSORB_INITIALIZED && dsorb_initializer_wrong_probability(initializer[k]) < 0.011);
    dsorb_frame frame[kFrames];
    const size_t frames = dsorb_initializer_frames(initializer[k], frame, kFrames);
    CHECK(frame[frames - 1].has_covariance && frame[frames - 1].covariance[0] > 0);
    const double* t = frame[frames - 1].cam_from_ref;
    sideways[k] = (fabs(t[7]) + fabs(t[11])) / fabs(t[3]);
    dsorb_initializer_destroy(initializer[k]);
  }
  CHECK(sideways[1] < 0.5 * sideways[0]); /* .0030 of the way against .0113 */
  return 0;
}

/* What the mask hides, here one half of the image with other contents every time, is used by nothing. */
static int checkMask(const dsorb_camera* camera, uint8_t* pixels) {
  char error[kErrorSize] = "";
  dsorb_odometry* odometry[2] = {NULL, NULL};
  dsorb_estimate estimate[2];
  enum { kStride = kWidth + 3 };
  uint8_t* mask = calloc(kHeight, kStride);
  CHECK(mask != NULL);
  for (int i = 0; i < kHeight * kStride; ++i) mask[i] = i % kStride < kWidth / 2;
  for (int k = 0; k < 2; ++k) {
    CHECK(dsorb_odometry_create("orb", camera, 1, &odometry[k], error, sizeof error) == DSORB_OK);
  }
  for (int i = 0; i < kFrames; ++i) {
    dsorb_image image = imageOf(i, pixels);
    image.mask = mask;
    image.mask_stride = 3;
    if (i == 0) {
      CHECK(dsorb_odometry_add(odometry[0], &image, estimate, error, sizeof error) == DSORB_BAD_ARGUMENT);
      CHECK(strstr(error, "stride") != NULL);
    }
    image.mask_stride = kStride;
    for (int k = 0; k < 2; ++k) {
      for (int p = 0; k == 1 && p < kWidth * kHeight; ++p) {
        if (p % kWidth >= kWidth / 2) pixels[p] = (uint8_t)(p * (i + 7));
      }
      CHECK(dsorb_odometry_add(odometry[k], &image, &estimate[k], error, sizeof error) == DSORB_OK);
    }
    CHECK(estimate[0].has_pose == estimate[1].has_pose);
    for (int c = 0; estimate[0].has_pose && c < 12; ++c) {
      CHECK(estimate[0].world_from_cam[c] == estimate[1].world_from_cam[c]);
    }
  }
  CHECK(estimate[0].has_pose);
  const size_t count = dsorb_odometry_points(odometry[0], NULL, 0);
  dsorb_point* point = malloc(count * sizeof *point);
  CHECK(count > 0 && point != NULL && dsorb_odometry_points(odometry[0], point, count) == count);
  for (size_t i = 0; i < count; ++i) CHECK(point[i].u < kWidth / 2);
  free(point);
  free(mask);
  for (int k = 0; k < 2; ++k) dsorb_odometry_destroy(odometry[k]);
  return 0;
}

int main(void) {
  const dsorb_camera camera = {kFocal, kFocal, kWidth / 2, kHeight / 2, kWidth, kHeight, 0, 0, 0};
  uint8_t* pixels = malloc((size_t)kWidth * kHeight);
  const int failed = pixels == NULL || checkErrors(&camera) || checkInitializer(&camera, pixels) ||
                     checkOdometry(&camera, pixels) || checkPriors(&camera, pixels) || checkReadout(&camera, pixels) ||
                     checkMask(&camera, pixels);
  free(pixels);
  return failed;
}
