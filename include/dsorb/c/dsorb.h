/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file
 * Initializer and odometry for callers in C and in languages that call C. Link dsorb::odometry.
 *
 * Conventions are those of docs/library.md: rectified pinhole cameras in pixels, the centre of the
 * top-left pixel at (0, 0); poses are 3 x 4 matrices [R | t], row after row, and `cam_from_ref`
 * maps points of the reference camera to the camera. Times are in seconds. The unit of length is
 * such that the mean inverse depth of a reference's points is 1; an odometry tells a segment in
 * metres where priors have given its start a scale.
 *
 * Functions that may fail return a dsorb_status. On failure the text that says why is in `error`,
 * a buffer of the caller's with `error_size` bytes that may be NULL; it is cut to fit and always
 * ends with a zero. No exception leaves these functions. One thread at a time may use an object.
 */
/* NOLINTBEGIN(modernize-*,readability-identifier-naming): this is C. */
#ifndef DSORB_C_DSORB_H
#define DSORB_C_DSORB_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Answer of a call. */
typedef enum dsorb_status {
  DSORB_OK = 0,
  DSORB_BAD_ARGUMENT = 1, /**< a mistake of the caller: NULL, image size, time, unknown option */
  DSORB_WRONG_STATE = 2,  /**< a call after a result or after the end */
  DSORB_FAILED = 3        /**< anything else, for example no memory */
} dsorb_status;

/** What a frame led to. */
typedef enum dsorb_state {
  DSORB_INITIALIZING = 0, /**< more frames are needed */
  DSORB_INITIALIZED = 1,  /**< with this frame */
  DSORB_TRACKED = 2,      /**< the frame has a pose (odometry only) */
  DSORB_LOST = 3,         /**< the next frame needs dsorb_odometry_restart (odometry only) */
  DSORB_MISSED = 4        /**< the frame has no pose, the map stands (odometry only) */
} dsorb_state;

/** Rectified pinhole camera [px]. Members of the readout that are zero: a global shutter. */
typedef struct dsorb_camera {
  double fx;               /**< focal length */
  double fy;               /**< focal length */
  double cx;               /**< principal point */
  double cy;               /**< principal point */
  int32_t width;           /**< of the images */
  int32_t height;          /**< of the images */
  int32_t columns;         /**< 1: columns are read one after the other instead of rows */
  double readout_ms;       /**< first to last row of the image; below 0: the last comes first */
  double readout_sigma_ms; /**< above 0: the odometry estimates the readout */
} dsorb_camera;

/** Depth at a point of the image. */
typedef struct dsorb_depth {
  float x;     /**< column [px] */
  float y;     /**< row [px] */
  float depth; /**< along the optical axis, above 0 [m] */
  float sigma; /**< standard deviation, above 0 [m] */
} dsorb_depth;

/** What a dsorb_priors knows of the camera's motion. */
typedef enum dsorb_motion {
  DSORB_NO_MOTION = 0,
  DSORB_ROTATION = 1, /**< of cam_from_since and covariance only the rotation counts */
  DSORB_POSE = 2
} dsorb_motion;

/** What is known of a frame beside its image, tested against the images; docs/library.md. All
 * zeros: nothing. It is copied. */
typedef struct dsorb_priors {
  const float* depths;          /**< of all pixels, row after row [m], NaN or 0: unknown; or NULL */
  double depth_sigma;           /**< constant part of their standard deviation [m] */
  double depth_relative_sigma;  /**< proportional part [-] */
  const dsorb_depth* samples;   /**< of a few pixels, where `depths` is NULL; or NULL */
  size_t sample_count;          /**< of `samples` */
  int32_t depth_scale_unknown;  /**< 1: depths are right but for one factor */
  dsorb_motion motion;          /**< what the next three say */
  int32_t motion_since;         /**< id of the earlier frame */
  double cam_from_since[12];    /**< 3 x 4, row after row [m] */
  double motion_covariance[36]; /**< 6 x 6 of a left increment, [translation; rotation] */
  int32_t has_distance;         /**< 1: the next three are set */
  int32_t distance_since;       /**< id of the earlier frame */
  double distance;              /**< between the camera centres [m] */
  double distance_sigma;        /**< standard deviation [m] */
} dsorb_priors;

/** One rectified grey image. It is copied. Members that are zero are as if not given. */
typedef struct dsorb_image {
  const uint8_t* data;        /**< grey levels of the camera's size */
  size_t stride;              /**< bytes from row to row; 0: rows follow each other */
  int32_t id;                 /**< unique among the frames given, 0 or above */
  double timestamp;           /**< [s] */
  double exposure;            /**< [s]; 0 or 1 when unknown */
  const dsorb_priors* priors; /**< NULL: none */
  const uint8_t* mask;        /**< of the camera's size; 0: the pixel is not used; NULL: all are */
  size_t mask_stride;         /**< bytes from row to row of the mask; 0: rows follow each other */
} dsorb_image;

/** One of the frames of a start. */
typedef struct dsorb_frame {
  int32_t id;              /**< as given with the image */
  int32_t posed;           /**< 0: the frame could not be posed, only id and timestamp are set */
  double timestamp;        /**< [s] */
  double cam_from_ref[12]; /**< 3 x 4, row after row */
  double a;                /**< brightness: log gain, relative to the reference */
  double b;                /**< brightness: offset [grey levels], relative to the reference */
  int32_t has_covariance;  /**< 0: covariance is not set */
  double covariance[36];   /**< 6 x 6, of a left increment [translation; rotation] */
} dsorb_frame;

/** A point that was found in its host. */
typedef struct dsorb_point {
  int32_t host;        /**< of a start: index into its frames; of an odometry: id of the keyframe */
  float u;             /**< column in the host [px] */
  float v;             /**< row in the host [px] */
  float inverse_depth; /**< along the host's optical axis [1/unit] */
  float variance;      /**< of the inverse depth [1/unit^2]; 0: unknown */
} dsorb_point;

/** Estimate of one frame. */
typedef struct dsorb_estimate {
  dsorb_state state;            /**< after this frame */
  int32_t has_pose;             /**< 0: world_from_cam is not set */
  int32_t is_keyframe;          /**< 1: the map hosts points in it */
  int32_t segment;              /**< a new one, with a world of its own, begins after a loss */
  double world_from_cam[12];    /**< 3 x 4, row after row; world: the segment's reference camera */
  int32_t keyframe;             /**< id of the keyframe it was tracked against; -1: none */
  int32_t has_covariance;       /**< 0: covariance is not set */
  double cam_from_keyframe[12]; /**< 3 x 4, before any adjustment; set where keyframe is */
  /** 6 x 6, of a left increment [translation; rotation] of cam_from_keyframe, in the segment's unit
   *  and in rad. It says nothing of the keyframe's own pose. Like
   *  world_covariance it grows where the window suspects the calibration. */
  double covariance[36];
  int32_t is_metric; /**< 1: the segment's unit is the metre, by priors; 0: mean inverse depth 1 */
  int32_t has_world_covariance; /**< 0: world_covariance is not set */
  /** 6 x 6, of a left increment of cam_from_world as tracked, where the window's keyframes taken
   *  together are not moved, turned or scaled. */
  double world_covariance[36];
} dsorb_estimate;

typedef struct dsorb_initializer dsorb_initializer; /**< opaque */
typedef struct dsorb_odometry dsorb_odometry;       /**< opaque */

/** Version of the library that is linked, for example "0.4.0". */
const char* dsorb_version(void);

/**
 * Makes an initializer.
 * @param name    as on the command line, for example "orb" or "coarse", or a registered one
 * @param threads of the inner loops; 0: all the machine has
 * @param out     receives the object, to be given to dsorb_initializer_destroy; NULL on failure
 */
dsorb_status dsorb_initializer_create(const char* name,
                                      const dsorb_camera* camera,
                                      int32_t threads,
                                      dsorb_initializer** out,
                                      char* error,
                                      size_t error_size);

/**
 * Gives the next frame, in time order.
 * @param state DSORB_INITIALIZING, or DSORB_INITIALIZED: then frames and points can be read, and
 *              dsorb_initializer_reset must come before the next frame
 */
dsorb_status dsorb_initializer_add(dsorb_initializer* initializer,
                                   const dsorb_image* image,
                                   dsorb_state* state,
                                   char* error,
                                   size_t error_size);

/**
 * Copies at most `capacity` frames of the start, the reference first.
 * @param out may be NULL where capacity is 0
 * @return    how many there are; 0 before a start
 */
size_t dsorb_initializer_frames(const dsorb_initializer* initializer,
                                dsorb_frame* out,
                                size_t capacity);

/**
 * Copies at most `capacity` points of the start.
 * @param out may be NULL where capacity is 0
 * @return    how many there are; 0 before a start
 */
size_t dsorb_initializer_points(const dsorb_initializer* initializer,
                                dsorb_point* out,
                                size_t capacity);

/**
 * Length of the start's unit, where priors give it.
 * @param metres         of one unit [m]
 * @param relative_sigma its relative standard deviation [-]; may be NULL
 * @return               1 where it is known, else 0 and nothing is written
 */
int32_t dsorb_initializer_metric(const dsorb_initializer* initializer,
                                 double* metres,
                                 double* relative_sigma);

/**
 * Probability that the direction of translation is off by more than 10 degrees: of the start, or
 * while `orb` waits of the newest frame's motion.
 * @return 1 where none is known, as after a frame without an attempt that came to the gate
 */
double dsorb_initializer_wrong_probability(const dsorb_initializer* initializer);

/**
 * From the next frame on: whether other images wait behind it already. `orb` then only follows its
 * corners and puts an attempt off. Kept by dsorb_initializer_reset.
 */
void dsorb_initializer_set_hurried(dsorb_initializer* initializer, int32_t hurried);

/** Makes the object equal to a fresh one. */
dsorb_status dsorb_initializer_reset(dsorb_initializer* initializer,
                                     char* error,
                                     size_t error_size);

/** Takes NULL too. */
void dsorb_initializer_destroy(dsorb_initializer* initializer);

/** Makes an odometry that starts from the named initializer; arguments as above. */
dsorb_status dsorb_odometry_create(const char* name,
                                   const dsorb_camera* camera,
                                   int32_t threads,
                                   dsorb_odometry** out,
                                   char* error,
                                   size_t error_size);

/** Gives the next frame, in time order, and receives its estimate. */
dsorb_status dsorb_odometry_add(dsorb_odometry* odometry,
                                const dsorb_image* image,
                                dsorb_estimate* estimate,
                                char* error,
                                size_t error_size);

/** From the next frame on, as dsorb_initializer_set_hurried. */
void dsorb_odometry_set_hurried(dsorb_odometry* odometry, int32_t hurried);

/**
 * Copies at most `capacity` points of the newest keyframe that has points.
 * @param out may be NULL where capacity is 0
 * @return    how many there are
 */
size_t dsorb_odometry_points(const dsorb_odometry* odometry, dsorb_point* out, size_t capacity);

/** After DSORB_LOST: the next frame begins a new segment. */
dsorb_status dsorb_odometry_restart(dsorb_odometry* odometry, char* error, size_t error_size);

/** Takes NULL too. */
void dsorb_odometry_destroy(dsorb_odometry* odometry);

#ifdef __cplusplus
}
#endif

#endif
/* NOLINTEND(modernize-*,readability-identifier-naming) */
