// SPDX-License-Identifier: BSD-3-Clause
#include "io/png.h"

#include "dsorb/error.h"

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstring>
#include <stdexcept>

namespace dsorb {
namespace {

constexpr png_fixed_point kRed = 29900;  // of grey, in 1 / 100000
constexpr png_fixed_point kGreen = 58700;

/// What libpng says of a file. It reports errors by a jump out of its functions: whatever it is
/// called from holds plain values only.
struct Complaint {
  std::array<char, 128> text{};
};

[[noreturn]] void onPngError(png_structp png, png_const_charp message) {
  auto& text = static_cast<Complaint*>(png_get_error_ptr(png))->text;
  std::strncpy(text.data(), message, text.size() - 1);
  png_longjmp(png, 1);
}

void onWarning(png_structp /*png*/, png_const_charp /*message*/) {}

/// A file in memory that is read.
struct Reader {
  explicit Reader(const std::vector<std::uint8_t>& bytes)
      : next(bytes.data()),
        left(bytes.size()),
        png(png_create_read_struct(PNG_LIBPNG_VER_STRING, &complaint, onPngError, onWarning)),
        info(png_create_info_struct(png)) {
    png_set_read_fn(png, this, [](png_structp from, png_bytep to, std::size_t size) {
      auto& reader = *static_cast<Reader*>(png_get_io_ptr(from));
      if (size > reader.left) png_error(from, "the file ends too early");
      std::copy_n(reader.next, size, to);
      reader.next += size;
      reader.left -= size;
    });
  }
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  Complaint complaint;
  const std::uint8_t* next;
  std::size_t left;
  png_structp png;
  png_infop info;
};

/// Reads the header and asks for one grey channel. @return whether that went well
bool readPngHeader(Reader& r) {
  if (setjmp(png_jmpbuf(r.png)) != 0) return false;
  png_read_info(r.png, r.info);
  const int colour = png_get_color_type(r.png, r.info);
  if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(r.png);
  if (png_get_bit_depth(r.png, r.info) < 8) png_set_expand_gray_1_2_4_to_8(r.png);
  if (png_get_bit_depth(r.png, r.info) == 16) png_set_swap(r.png);
  png_set_strip_alpha(r.png);
  if ((colour & PNG_COLOR_MASK_COLOR) != 0) {
    png_set_rgb_to_gray_fixed(r.png, PNG_ERROR_ACTION_NONE, kRed, kGreen);
  }
  png_set_interlace_handling(r.png);
  png_read_update_info(r.png, r.info);
  return true;
}

/// @param rows of the image, to be filled
/// @return whether all of the file was there
bool readPngRows(Reader& r, png_bytepp rows) {
  if (setjmp(png_jmpbuf(r.png)) != 0) return false;
  png_read_image(r.png, rows);
  png_read_end(r.png, nullptr);
  return true;
}

std::vector<png_bytep> rowsOf(cv::Mat& image) {
  std::vector<png_bytep> rows;
  rows.reserve(static_cast<std::size_t>(image.rows));
  for (int y = 0; y < image.rows; ++y) rows.push_back(image.ptr(y));
  return rows;
}

/// A file in memory that is written.
struct Writer {
  Writer()
      : png(png_create_write_struct(PNG_LIBPNG_VER_STRING, &complaint, onPngError, onWarning)),
        info(png_create_info_struct(png)) {
    const auto append = [](png_structp to, png_bytep data, std::size_t size) {
      static_cast<Writer*>(png_get_io_ptr(to))->bytes.append(reinterpret_cast<char*>(data), size);
    };
    png_set_write_fn(png, this, append, [](png_structp) {});
  }
  ~Writer() { png_destroy_write_struct(&png, &info); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  Complaint complaint;
  std::string bytes;
  png_structp png;
  png_infop info;
};

/// @return whether libpng took it
bool write(Writer& w, const cv::Mat& image, int compression, png_bytepp rows) {
  if (setjmp(png_jmpbuf(w.png)) != 0) return false;
  png_set_compression_level(w.png, compression);
  png_set_filter(w.png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
  png_set_IHDR(w.png,
               w.info,
               static_cast<png_uint_32>(image.cols),
               static_cast<png_uint_32>(image.rows),
               image.depth() == CV_16U ? 16 : 8,
               image.channels() == 3 ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_GRAY,
               PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  png_write_info(w.png, w.info);
  png_set_bgr(w.png);
  if (image.depth() == CV_16U) png_set_swap(w.png);
  png_write_image(w.png, rows);
  png_write_end(w.png, nullptr);
  return true;
}

}  // namespace

bool isPng(const std::vector<std::uint8_t>& bytes) {
  constexpr std::size_t kSignature = 8;
  return bytes.size() >= kSignature && png_sig_cmp(bytes.data(), 0, kSignature) == 0;
}

cv::Mat decodePng(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  Reader reader(bytes);
  cv::Mat image;
  bool done = readPngHeader(reader);
  if (done) {
    const auto width = static_cast<int>(png_get_image_width(reader.png, reader.info));
    const auto height = static_cast<int>(png_get_image_height(reader.png, reader.info));
    const bool deep = png_get_bit_depth(reader.png, reader.info) == 16;
    image.create(height, width, deep ? CV_16UC1 : CV_8UC1);
    std::vector<png_bytep> rows = rowsOf(image);
    done = readPngRows(reader, rows.data());
  }
  if (!done) {
    throw IoError(fmt::format(
        "{}: the image is truncated or damaged: {}", name, reader.complaint.text.data()));
  }
  return image;
}

std::string encodePng(const cv::Mat& image, int compression) {
  const int type = image.type();
  if (image.empty() || (type != CV_8UC1 && type != CV_16UC1 && type != CV_8UC3)) {
    throw std::invalid_argument(fmt::format(
        "encodePng: expected a grey image of 8 or 16 bits or BGR, got OpenCV's type {}", type));
  }
  Writer writer;
  cv::Mat pixels = image;
  std::vector<png_bytep> rows = rowsOf(pixels);
  if (!write(writer, image, compression, rows.data())) {
    throw std::runtime_error(fmt::format("libpng: {}", writer.complaint.text.data()));
  }
  return std::move(writer.bytes);
}

}  // namespace dsorb
